"""Formulas of the network: what makes a module or wire active, and an actuator be by a module."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import assert_never

from colony.ir.frame import MISSED, Answer
from colony.ir.program import Actuator, AnyModule, Chain, Limit, Module, PythonModule, Use, Wiring
from colony.ir.types import ScalarValue
from colony.ir.walk import expressions_of
from colony.text.source import Span
from colony.verify.claims import source_text
from colony.verify.explain.causes import (
    Answered,
    Heard,
    Sendable,
    TimeConstant,
    Undisturbed,
    UnknownCondition,
    Unwired,
)
from colony.verify.explain.conditions import Conditions, inputs_text, pair_text
from colony.verify.explain.formula import Formula, Leaf, group, negation
from colony.verify.explain.moment import Moment

# --- network -------------------------------------------------------------------------------------------


Node = tuple[str | int, ...]
"""A suppressor or inhibitor: its wire, and the indices of operands that lead to it."""


class NetworkExplainer:
    """Builds the formulas of the network in one moment. Stateful: remembers those of modules and wires."""

    def __init__(self, moment: Moment) -> None:
        self.moment = moment
        self.conditions = Conditions(moment, self)
        self._modules: dict[str, AnyModule] = {m.name: m for m in moment.program.modules}
        self._wiring = {w.actuator: w for w in moment.program.wires if w.actuator is not None}
        self._active: dict[str, Formula] = {}

    # --- activity --------------------------------------------------------------------------------

    def active(self, name: str) -> Formula:
        """Return the formula of "this module or wire is active"."""
        if name in self._modules:
            found = self._active.get(name)
            if found is None:
                found = self._active[name] = self._module_active(self._modules[name])
            return found
        if name not in self._active:
            for wire in self.moment.program.wires:  # each comes after those that it uses
                if wire.actuator is None and wire.name not in self._active:
                    part = self._wiring_active(wire.wiring, (wire.name,))
                    self._active[wire.name] = group(
                        "all", (part,), subject="wire", name=wire.name, span=wire.span
                    )
        return self._active[name]

    def _module_active(self, module: AnyModule) -> Formula:
        moment, name = self.moment, module.name
        present = self.conditions.presence(expressions_of(module))
        is_missing = not all(leaf.holds for leaf in present)
        if is_missing:
            cause = UnknownCondition(condition=f"the predicate of {name}")
            decides = Leaf(
                holds=True, cause=cause, key=("predicate", name), implied=True, free=True, fixed=True
            )
            parts: list[Formula] = [*present, decides]
        else:
            parts = [*(replace(leaf, implied=True) for leaf in present), self._applicable(module)]
        if module.failsafe:
            has_all = group("all", parts[: len(present)])
            parts = [group("any", (negation(has_all), *parts[len(present) :]))]
        if name in moment.lost and not module.failsafe:
            parts.append(
                Leaf(holds=False, cause=Heard(module=name, fate="lost"), key=("heard", name), fixed=True)
            )
        return group("all", parts, subject="module", name=name, span=module.span)

    def _applicable(self, module: AnyModule) -> Formula:
        """Return the formula of "the module commands", given that nothing that it reads is missing."""
        match module:
            case Module(name=name, when=when):
                predicate = (self.conditions.formula(when),)
                return group("all", predicate, subject="predicate", name=name, span=when.span)
            case PythonModule():
                return self._answered(module)
            case _:
                assert_never(module)

    def _answered(self, module: PythonModule) -> Leaf:
        answer = self.moment.answers.get(module.name, Answer())
        is_blind = module.name in self.moment.blind
        cause = Answered(module=module.name, error=answer.error, blind=answer.blind)
        holds = is_blind or module.name in self.moment.values.commands
        return Leaf(holds=holds, cause=cause, key=("answer", module.name), span=module.span)

    def _wiring_active(self, wiring: Wiring, node: Node) -> Formula:
        if isinstance(wiring, Use):
            return self.active(wiring.name)
        *dominant, last = (self._wiring_active(w, (*node, i)) for i, w in enumerate(wiring.operands))
        if wiring.relation == "inhibits":
            cut = [negation(self._dominates(wiring, i, node, d)) for i, d in enumerate(dominant)]
            return group("all", (last, *cut))
        options: list[Formula] = [last]  # in reverse order
        for i in reversed(range(len(dominant))):
            if wiring.windows_ns[i]:
                window = negation(self._window(wiring, i, node))
                options = [group("all", (group("any", options[::-1]), window))]
            options.append(dominant[i])
        return group("any", options[::-1])

    def _dominates(self, chain: Chain, i: int, node: Node, active: Formula) -> Formula:
        """Return the formula of "operand `i` suppresses or inhibits what follows it"."""
        window = (self._window(chain, i, node),) if chain.windows_ns[i] else ()
        return group("any", (active, *window), subject="dominated", name=chain.relation)

    def _window(self, chain: Chain, i: int, node: Node) -> Leaf:
        path = (*node, i)
        at_ns = self.moment.last_active_ns.get(path)
        elapsed = None if at_ns is None else self.moment.t_ns - at_ns
        cause = TimeConstant(
            dominant=_name_of(chain.operands[i]),
            window_ns=chain.windows_ns[i],
            at_ns=at_ns,
            elapsed_ns=elapsed,
        )
        holds = elapsed is not None and elapsed < chain.windows_ns[i]
        return Leaf(
            holds=holds, cause=cause, key=("window", *path), span=chain.span, fixed=self.moment.is_first
        )

    # --- actuators -------------------------------------------------------------------------------

    def is_by(self, actuator: str, module: str) -> Formula:
        """Return the formula of "the actuator is by this module"."""
        parts: list[Formula] = [self.gets_through(actuator, module), *self._runtime(actuator, module)]
        return group("all", parts, subject="winner", name=f"{actuator} is by {module}")

    def is_commanded(self, actuator: str) -> Formula:
        """Return the formula of "a module's command is sent to this actuator"."""
        wire = self._wiring.get(actuator)
        if wire is None:
            return _unwired(actuator, None)
        active = self._wiring_active(wire.wiring, (wire.name,))
        winner = self.moment.outcome.commands[actuator].by
        parts = [active, *self._runtime(actuator, winner), *self._sendable(actuator)]
        return group("all", parts, subject="winner", name=f"{actuator} is commanded")

    def gets_through(self, actuator: str, module: str) -> Formula:
        """Return the formula of "the network lets this module's command through to the actuator"."""
        root = self._wiring.get(actuator)
        found: dict[str, Formula] = {module: self.active(module)}
        for wire in self.moment.program.wires:  # each comes after those that it uses
            through = self._through(wire.wiring, (wire.name,), found)
            if through is not None:
                if wire is root:
                    return through
                if wire.actuator is None:
                    found[wire.name] = through
        return _unwired(actuator, module)

    def _through(self, wiring: Wiring, node: Node, found: dict[str, Formula]) -> Formula | None:
        """Return the formula of "the output is the module's", None if the wiring never lets it through."""
        if isinstance(wiring, Use):
            return found.get(wiring.name)
        options: list[Formula] = []
        cut: list[Formula] = []
        last = len(wiring.operands) - 1
        for i, operand in enumerate(wiring.operands):
            through = None
            if i == last or wiring.relation == "suppresses":
                through = self._through(operand, (*node, i), found)
            if through is not None:
                options.append(group("all", (through, *cut)))
            if i < last:
                active = self._wiring_active(operand, (*node, i))
                cut.append(negation(self._dominates(wiring, i, node, active)))
        if not options:
            return None
        return options[0] if len(options) == 1 else group("any", options)

    def _runtime(self, actuator: str, module: str | None) -> list[Formula]:
        """Return the conditions that the network alone decided, and that the winner's request was in time."""
        verdict = self.moment.verdicts.get(actuator)
        if verdict is None and actuator in self.moment.late:
            late = Heard(module=module or actuator, fate="late")
            return [Leaf(holds=False, cause=late, key=("heard", module or actuator))]
        if verdict is None:
            return []
        disturbed = verdict.outside is not None or verdict.hold is not None
        cause = Undisturbed(actuator=actuator, outside=verdict.outside, hold=verdict.hold)
        key = "undisturbed", actuator
        found: list[Formula] = [Leaf(holds=not disturbed, cause=cause, key=key, implied=not disturbed)]
        missed = {client: fate for client, fate in verdict.fates if fate in MISSED}
        if module is not None:
            heard = Heard(module=module, fate=missed.get(module))
            in_time = module not in missed
            found.append(Leaf(holds=in_time, cause=heard, key=("heard", module), implied=in_time))
        return found

    def _sendable(self, actuator: str) -> list[Formula]:
        fault = self.moment.fault(actuator)
        winner = self.moment.winner(actuator)
        if winner is None:
            return []
        cause = Sendable(actuator=actuator, module=winner, fault=fault)
        sendable = fault is None
        return [Leaf(holds=sendable, cause=cause, key=("sendable", actuator), implied=sendable)]


def _unwired(actuator: str, module: str | None) -> Leaf:
    """Return the formula of what the wiring makes impossible."""
    cause = Unwired(actuator=actuator, module=module)
    return Leaf(holds=False, cause=cause, key=("wired", actuator), fixed=True)


def _name_of(wiring: Wiring) -> str:
    """Return a text for what a wiring is."""
    if isinstance(wiring, Use):
        return wiring.name
    text = " ".join(wiring.span.text.split())
    return f"({text})" if text else "a part of the network"


# --- command -------------------------------------------------------------------------------------------
#
# What became of a command: the fields that a limit or the range of the actuator changed.


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """A field of a command that was changed before it was sent.

    `wanted` and `sent` are values with units. `limit` is the bound as written, None for the range of the
    actuator; `is_missing` is true if the bound read something missing, so that the idle command's value stood
    in for it. `detail` has the values that the bound reads.
    """

    field: str
    wanted: str
    sent: str
    limit: str | None
    is_missing: bool = False
    detail: tuple[str, ...] = ()
    span: Span | None = None


def cuts(moment: Moment, actuator: str) -> tuple[Cut, ...]:
    """Return what limits and ranges changed in the winner's command; nothing if it was not sent."""
    declared = next(a for a in moment.program.robot.actuators if a.name == actuator)
    winner = moment.winner(actuator)
    command = None if winner is None else moment.values.commands.get(winner)
    sent = moment.sent(actuator)
    if not command or sent is None or moment.fault(actuator) is not None:
        return ()
    found: list[Cut] = []
    conditions = NetworkExplainer(moment).conditions
    for i, wanted in enumerate(command):
        bounded = _bounded(moment, declared, i, wanted)
        if bounded != wanted:
            found.append(_cut(moment, conditions, declared, i, wanted, bounded))
    return tuple(found)


def _effective(moment: Moment, actuator: Actuator, i: int) -> list[tuple[Limit, float, bool]]:
    """Return the limits of a field that apply, each with its bound, and whether that stands in."""
    idle = None if actuator.idle is None else actuator.idle[i]
    found = []
    for limit, bound in moment.limits:
        if (limit.actuator, limit.field_index) == (actuator.name, i):
            value = idle if bound is None else bound
            if value is not None:
                found.append((limit, float(value), bound is None))
    return found


def _bounded(moment: Moment, actuator: Actuator, i: int, wanted: ScalarValue) -> ScalarValue:
    field = actuator.fields[i]
    low = -math.inf if field.low is None else field.low
    high = math.inf if field.high is None else field.high
    for limit, bound, _ in _effective(moment, actuator, i):
        low, high = (low, min(high, bound)) if limit.relation == "<=" else (max(low, bound), high)
    return low if wanted < low else high if wanted > high else wanted


def _cut(
    moment: Moment,
    conditions: Conditions,
    actuator: Actuator,
    i: int,
    wanted: ScalarValue,
    bounded: ScalarValue,
) -> Cut:
    field = actuator.fields[i]
    texts = pair_text(wanted, bounded, field.type, field.type)
    relation = "<=" if wanted > bounded else ">="
    for limit, bound, is_missing in _effective(moment, actuator, i):
        if limit.relation == relation and bound == bounded:
            condition = "" if limit.condition is None else f" when {source_text(limit.condition)}"
            text = f"{actuator.name}.{field.name} {relation} {source_text(limit.bound)}{condition}"
            return Cut(
                field=field.name,
                wanted=texts[0],
                sent=texts[1],
                limit=text,
                is_missing=is_missing,
                detail=inputs_text(limit.bound, conditions.value),
                span=limit.span,
            )
    return Cut(field=field.name, wanted=texts[0], sent=texts[1], limit=None, span=field.span)
