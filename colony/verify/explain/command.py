"""What became of a command: the fields that a limit or the range of the actuator changed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from colony.ir.program import Actuator, Limit
from colony.ir.types import ScalarValue
from colony.text.source import Span
from colony.verify.explain.comparisons import inputs_text
from colony.verify.explain.conditions import Conditions
from colony.verify.explain.moment import Moment
from colony.verify.explain.network import Network
from colony.verify.explain.values import pair_text
from colony.verify.source_text import source_text


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
    conditions = Network(moment).conditions
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
