"""The command sent: the winner's command, limited and clamped, or the idle command."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import z3

from colony.ir import program as ir
from colony.ir.types import BOOL, Bool, any_value
from colony.verify.symbolic.builder import Builder, FrameValues, missing
from colony.verify.symbolic.cases import constant
from colony.verify.symbolic.expressions import Expressions, constant_term
from colony.verify.symbolic.functions import boolean, number
from colony.verify.symbolic.logic import FALSE, TRUE, all_of, any_of, both, either, is_false, negation
from colony.verify.symbolic.memory import open_scalar_cell
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
    Inexact,
    ModuleTerms,
    Number,
    OutsideInput,
    Reason,
    Scalar,
)


@dataclass(frozen=True, slots=True)
class Bound:
    """A limit in the frame: the conditions that it applies and is known, and its bound, which is finite.

    A bound that is missing or not finite stands at the idle command's value; without one it is not known.
    """

    limit: ir.Limit
    applies: z3.BoolRef
    known: z3.BoolRef
    bound: Number


def limits(program: ir.Program, builder: Builder, frame_values: FrameValues) -> list[Bound]:
    """Return all limits, in the order written."""
    idle = {actuator.name: actuator.idle for actuator in program.robot.actuators}
    found = []
    for limit in program.limits:
        hint = f"limit {limit.actuator}"
        absent = missing(limit.bound, frame_values)
        bound_encoder = Expressions(
            builder=builder, frame_values=frame_values, advances=negation(absent), hint=hint
        )
        value = number(bound_encoder.scalar(limit.bound))
        applies = TRUE
        if limit.condition is not None:
            unknown = missing(limit.condition, frame_values)
            asked = Expressions(
                builder=builder, frame_values=frame_values, advances=negation(unknown), hint=hint
            )
            applies = any_of((unknown, absent, asked.boolean(limit.condition)))
        sound = both(negation(absent), finite(value))
        command = idle[limit.actuator]
        if command is None:
            found.append(Bound(limit, applies, sound, as_finite(value)))
            continue
        standing = select_number(sound, as_finite(value), constant(float(command[limit.field_index])))
        found.append(Bound(limit, applies, TRUE, standing))
    return found


def as_finite(x: Number) -> Number:
    """Return `x`, assumed to be finite."""
    known = x.cases if all(math.isfinite(v) for v, _ in x.cases) else ()
    return replace(x, nan=FALSE, infinite=FALSE, cases=known)


def send(
    actuator: ir.Actuator,
    modules: Mapping[str, ModuleTerms],
    bounds: Sequence[Bound],
    builder: Builder,
    frame_values: FrameValues,
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
        all_of((w, negation(modules[m].blind), *(finite(x) for x in command if isinstance(x, Number))))
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
    actuator: ir.Actuator, commanded: z3.BoolRef, builder: Builder, label: str
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
    bounds: Sequence[Bound],
) -> Scalar:
    """Return one field of the winner's command, taken to be finite, within its limits and range."""
    if not values:
        return FALSE if isinstance(field.type, Bool) else constant(0.0)
    result = select_first(finite_wins, [_as_finite_scalar(x) for x in values])
    return _bounded(result, field, bounds) if isinstance(result, Number) else result


def _as_finite_scalar(x: Scalar) -> Scalar:
    return as_finite(x) if isinstance(x, Number) else x


def _bounded(x: Number, field: ir.ActuatorField, bounds: Sequence[Bound]) -> Number:
    """Return a finite field within its limits and range, which do not contradict each other."""
    for b in bounds:
        exceeds = compared(b.bound, x, "<") if b.limit.relation == "<=" else compared(x, b.bound, "<")
        x = select_number(both(b.applies, exceeds), b.bound, x)
    if field.low is not None:
        x = greatest((x, constant(field.low)))
    if field.high is not None:
        x = least((x, constant(field.high)))
    return x


def _possible(field: ir.ActuatorField, bounds: Sequence[Bound]) -> Iterator[z3.BoolRef]:
    """Yield the conditions that a field can be sent: its bounds are known, and none contradicts another."""
    yield from (either(negation(b.applies), b.known) for b in bounds)
    lower = [(b.applies, b.bound) for b in bounds if b.limit.relation == ">="]
    upper = [(b.applies, b.bound) for b in bounds if b.limit.relation == "<="]
    of_range = [] if field.low is None else [(TRUE, constant(field.low))]
    to_range = [] if field.high is None else [(TRUE, constant(field.high))]
    pairs = [*product(lower, upper), *product(of_range, upper), *product(lower, to_range)]
    for (low_applies, low), (high_applies, high) in pairs:
        yield any_of((negation(low_applies), negation(high_applies), compared(low, high, "<=")))


def _leaves(x: Scalar, field: ir.ActuatorField, builder: Builder) -> z3.BoolRef:
    """Return the condition that a field is finite in its declared unit, in which it is sent."""
    if not isinstance(x, Number) or field.factor >= 1:
        return TRUE
    maximum = constant(sys.float_info.max * field.factor)
    sendable = both(compared(x, maximum, "<="), compared(negated(maximum), x, "<="))
    text = f"`{field.name}` may be too large for a float in {field.unit}"
    builder.mark_inexact(sendable, Reason(Inexact.ROUNDING, field.span, text))
    return sendable
