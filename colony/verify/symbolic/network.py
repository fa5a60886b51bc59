"""The network: which module's output gets through to each wire and actuator (language reference, Network)."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from heapq import heappop, heappush
from itertools import accumulate, product
from typing import TypeAlias, assert_never

import z3

from colony.ir import program as ir
from colony.ir.types import BOOL, Bool, any_value
from colony.verify.symbolic.builder import SymbolicValues, SystemBuilder, missing
from colony.verify.symbolic.cases import constant
from colony.verify.symbolic.expressions import ExpressionEncoder, constant_term
from colony.verify.symbolic.functions import boolean, number
from colony.verify.symbolic.logic import FALSE, TRUE, all_of, any_of, both, either, is_false, negation
from colony.verify.symbolic.memory import Memory, open_scalar_cell
from colony.verify.symbolic.numbers import (
    compared,
    finite,
    greatest,
    least,
    negated,
    select,
    select_first,
    select_number,
)
from colony.verify.symbolic.system import (
    ActuatorTerms,
    ExtendedReal,
    Inexact,
    ModuleTerms,
    OutsideInput,
    Reason,
    Scalar,
)

# --- sending -------------------------------------------------------------------------------------------
#
# The command sent: the winner's command, limited and clamped, or the idle command.


@dataclass(frozen=True, slots=True)
class ActiveLimit:
    """A limit in the frame: the conditions that it applies and is known, and its bound, which is finite.

    A bound that is missing or not finite stands at the idle command's value; without one it is not known.
    """

    limit: ir.Limit
    applies: z3.BoolRef
    known: z3.BoolRef
    bound: ExtendedReal


def limits(program: ir.Program, builder: SystemBuilder, frame_values: SymbolicValues) -> list[ActiveLimit]:
    """Return all limits, in the order written."""
    idle = {actuator.name: actuator.idle for actuator in program.robot.actuators}
    found = []
    for limit in program.limits:
        hint = f"limit {limit.actuator}"
        absent = missing(limit.bound, frame_values)
        bound_encoder = ExpressionEncoder(
            builder=builder, frame_values=frame_values, advances=negation(absent), hint=hint
        )
        value = number(bound_encoder.scalar(limit.bound))
        applies = TRUE
        if limit.condition is not None:
            unknown = missing(limit.condition, frame_values)
            asked = ExpressionEncoder(
                builder=builder, frame_values=frame_values, advances=negation(unknown), hint=hint
            )
            applies = any_of((unknown, absent, asked.boolean(limit.condition)))
        sound = both(negation(absent), finite(value))
        command = idle[limit.actuator]
        if command is None:
            found.append(ActiveLimit(limit, applies, sound, as_finite(value)))
            continue
        standing = select_number(sound, as_finite(value), constant(float(command[limit.field_index])))
        found.append(ActiveLimit(limit, applies, TRUE, standing))
    return found


def as_finite(x: ExtendedReal) -> ExtendedReal:
    """Return `x`, assumed to be finite."""
    known = x.cases if all(math.isfinite(v) for v, _ in x.cases) else ()
    return replace(x, nan=FALSE, infinite=FALSE, cases=known)


def send(
    actuator: ir.Actuator,
    modules: Mapping[str, ModuleTerms],
    bounds: Sequence[ActiveLimit],
    builder: SystemBuilder,
    frame_values: SymbolicValues,
    outside: OutsideInput | None = None,
    label: str = "",
) -> ActuatorTerms:
    """Encode the command sent: the idle command if the winner's command is not finite, or has no bounds.

    With `outside`, its command counts where there is one. `label` distinguishes the memory of several
    encodings of one actuator.
    """
    wins = {m: w for m, w in frame_values.wins[actuator.name].items() if not is_false(w)}
    commands = [modules[m].command for m in wins]
    finite_wins = [
        all_of((w, negation(modules[m].blind), *(finite(x) for x in command if isinstance(x, ExtendedReal))))
        for (m, w), command in zip(wins.items(), commands, strict=True)
    ]
    if outside is not None:
        commands.append(outside.fields)
        finite_wins.append(outside.commands)
    limited = []
    possible: list[z3.BoolRef] = []
    for i, field in enumerate(actuator.fields):
        own = [b for b in bounds if b.limit.actuator == actuator.name and b.limit.field_index == i]
        limited.append(_field(field, finite_wins, [command[i] for command in commands], own))
        possible += _possible(field, own)
    leaves = (_leaves(x, field, builder) for x, field in zip(limited, actuator.fields, strict=True))
    commanded = frame_values.commanded[actuator.name] = all_of((any_of(finite_wins), *possible, *leaves))
    sent = []
    is_missing, hold = _holding(actuator, commanded, builder, label)
    for i, (field, x) in enumerate(zip(actuator.fields, limited, strict=True)):
        value = x if actuator.idle is None else select(commanded, x, constant_term(actuator.idle[i]))
        named = builder.named(value, f"{actuator.name}.{field.name}{label}")
        frame_values.sent[actuator.name, i] = (is_missing, hold(field, named))
        sent.append(named)
    return ActuatorTerms(wins=wins, commanded=commanded, sent=tuple(sent))


def _holding(
    actuator: ir.Actuator, commanded: z3.BoolRef, builder: SystemBuilder, label: str
) -> tuple[z3.BoolRef, Callable[[ir.ActuatorField, Scalar], Scalar]]:
    """Return the condition that fields are missing to contracts, and the value of each that contracts read.

    On `idle hold`, where nothing is sent, that is the last value sent, missing before the first.
    """
    if actuator.idle is not None:
        return FALSE, lambda _, sent: sent
    ever, set_ever = open_scalar_cell(builder, f"{actuator.name}.ever sent{label}", BOOL, False)
    was_sent = boolean(ever)
    set_ever(either(was_sent, commanded))

    def held(field: ir.ActuatorField, sent: Scalar) -> Scalar:
        name = f"{actuator.name}.{field.name}.held{label}"
        last, set_last = open_scalar_cell(builder, name, field.type, any_value(field.type))
        value = select(commanded, sent, last)
        set_last(value)
        return value

    return negation(either(was_sent, commanded)), held


def _field(
    field: ir.ActuatorField,
    finite_wins: Sequence[z3.BoolRef],
    values: Sequence[Scalar],
    bounds: Sequence[ActiveLimit],
) -> Scalar:
    """Return one field of the winner's command, taken to be finite, within its limits and range."""
    if not values:
        return FALSE if isinstance(field.type, Bool) else constant(0.0)
    result = select_first(finite_wins, [_as_finite_scalar(x) for x in values])
    return _bounded(result, field, bounds) if isinstance(result, ExtendedReal) else result


def _as_finite_scalar(x: Scalar) -> Scalar:
    return as_finite(x) if isinstance(x, ExtendedReal) else x


def _bounded(x: ExtendedReal, field: ir.ActuatorField, bounds: Sequence[ActiveLimit]) -> ExtendedReal:
    """Return a finite field within its limits and range, which do not contradict each other."""
    for b in bounds:
        exceeds = compared(b.bound, x, "<") if b.limit.relation == "<=" else compared(x, b.bound, "<")
        x = select_number(both(b.applies, exceeds), b.bound, x)
    if field.low is not None:
        x = greatest((x, constant(field.low)))
    if field.high is not None:
        x = least((x, constant(field.high)))
    return x


def _possible(field: ir.ActuatorField, bounds: Sequence[ActiveLimit]) -> Iterator[z3.BoolRef]:
    """Yield the conditions that a field can be sent: its bounds are known, and none contradicts another."""
    yield from (either(negation(b.applies), b.known) for b in bounds)
    lower = [(b.applies, b.bound) for b in bounds if b.limit.relation == ">="]
    upper = [(b.applies, b.bound) for b in bounds if b.limit.relation == "<="]
    of_range = [] if field.low is None else [(TRUE, constant(field.low))]
    to_range = [] if field.high is None else [(TRUE, constant(field.high))]
    pairs = [*product(lower, upper), *product(of_range, upper), *product(lower, to_range)]
    for (low_applies, low), (high_applies, high) in pairs:
        yield any_of((negation(low_applies), negation(high_applies), compared(low, high, "<=")))


def _leaves(x: Scalar, field: ir.ActuatorField, builder: SystemBuilder) -> z3.BoolRef:
    """Return the condition that a field is finite in its declared unit, in which it is sent."""
    if not isinstance(x, ExtendedReal) or field.factor >= 1:
        return TRUE
    maximum = constant(sys.float_info.max * field.factor)
    sendable = both(compared(x, maximum, "<="), compared(negated(maximum), x, "<="))
    text = f"`{field.name}` may be too large for a float in {field.unit}"
    builder.mark_inexact(sendable, Reason(Inexact.ROUNDING, field.span, text))
    return sendable


# --- network -------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Chain:
    """An encoded chain.

    Attributes:
        operands: The modules and chains that it joins, dominant ones first.
        open: For each operand, the condition that no operand before it dominates.
        merges: True if the outputs of all operands get through, not only that of the last.
    """

    operands: tuple[_Part, ...]
    open: tuple[z3.BoolRef, ...]
    merges: bool


_Part: TypeAlias = str | int
"""A part of the network: a module by its name, or a chain by its number."""


class NetworkEncoder:
    """Encodes the wires, each after its operands. Mutable."""

    def __init__(self, program: ir.Program, builder: SystemBuilder, frame_values: SymbolicValues) -> None:
        self.program = program
        self.builder = builder
        self.frame_values = frame_values
        self._chains: list[_Chain] = []
        self._active: list[z3.BoolRef] = []  # of the chains
        self._wires: dict[str, _Part] = {}

    def encode_wires(self) -> None:
        """Encode all wires into `frame_values`."""
        for actuator in self.program.robot.actuators:
            self.frame_values.wins[actuator.name] = {}
        for wire in self.program.wires:
            output = self._wiring(wire.wiring, wire.name)
            if wire.actuator is None:
                self._wires[wire.name] = output
                self.frame_values.active[wire.name] = self._is_active(output)
            else:
                self.frame_values.wins[wire.actuator] = self._through(output)

    def _is_active(self, part: _Part) -> z3.BoolRef:
        return self._active[part] if isinstance(part, int) else self.frame_values.active[part]

    def _wiring(self, wiring: ir.Wiring, wire: str) -> _Part:
        match wiring:
            case ir.Use(name=name):
                return self._wires.get(name, name)
            case ir.Chain():
                return self._chain(wiring, [self._wiring(o, wire) for o in wiring.operands], wire)
            case _:
                assert_never(wiring)

    def _chain(self, chain: ir.Chain, operands: list[_Part], wire: str) -> _Part:
        """Encode a chain: each operand but the last dominates what follows it."""
        count = len(operands) - 1
        hint = f"{wire}.{chain.relation}"
        dominates = [
            self._dominates(self._is_active(operands[i]), chain.windows_ns[i], hint) for i in range(count)
        ]
        rest = self._is_active(operands[count])  # the output of the operands from i + 1 on is active
        for i in reversed(range(count)):
            rest = both(rest, negation(dominates[i]))
            if chain.relation == "suppresses":
                rest = either(self._is_active(operands[i]), rest)
        undominated = accumulate(dominates, lambda before, d: both(before, negation(d)), initial=TRUE)
        self._chains.append(_Chain(tuple(operands), tuple(undominated), chain.relation == "suppresses"))
        self._active.append(rest)
        return len(self._chains) - 1

    def _dominates(self, active: z3.BoolRef, window_ns: int, hint: str) -> z3.BoolRef:
        """Return the condition that the dominant side is active, or was active less than `window_ns` ago."""
        return Memory(self.builder, self.frame_values, TRUE, hint).recently(active, window_ns)

    def _through(self, output: _Part) -> dict[str, z3.BoolRef]:
        """Return, for each module, the condition that its output gets through to `output`.

        From the output down, each chain is passed once, with the condition that its own output gets through.
        """
        conditions: dict[_Part, list[z3.BoolRef]] = {output: [TRUE]}
        pending = (
            [-output] if isinstance(output, int) else []
        )  # a chain has a greater number than its operands
        while pending:
            number = -heappop(pending)
            chain, through = self._chains[number], any_of(conditions[number])
            for i, operand in enumerate(chain.operands):
                if not chain.merges and i < len(chain.operands) - 1:
                    continue
                if operand not in conditions and isinstance(operand, int):
                    heappush(pending, -operand)
                conditions.setdefault(operand, []).append(both(through, chain.open[i]))
        return {
            module: both(any_of(conditions[module]), self.frame_values.active[module])
            for module in self._modules(output)
        }

    def _modules(self, output: _Part) -> list[str]:
        """Return the modules whose outputs can get through, dominant ones first."""
        found, seen, pending = list[str](), set[_Part](), [output]
        while pending:
            part = pending.pop()
            if part in seen:
                continue
            seen.add(part)
            if isinstance(part, str):
                found.append(part)
            else:
                operands = self._chains[part].operands
                pending += reversed(operands if self._chains[part].merges else operands[-1:])
        return found
