"""The decision for an actuator, given its winner."""

from __future__ import annotations

from typing import Any, NamedTuple

from colony.execute.code import ActuatorCode, ClientCode
from colony.execute.intake import Records
from colony.execute.settle import settle
from colony.ir.frame import Given
from colony.ir.program import Actuator
from colony.ir.types import ScalarValue


class ActuatorDecision(NamedTuple):
    """A decision with the command sent in base units, None if nothing is sent.

    `is_commanded` is true if the command is the winner's, or that of somebody outside the network.
    """

    by: str | None
    sent: tuple[ScalarValue, ...] | None
    fault: str | None
    records: Records
    is_commanded: bool = False


def decide(actuator: ActuatorCode, winner: ClientCode | None, values: list[Any]) -> ActuatorDecision:
    """Return the decision for an actuator: the winner's command, bounded, or the idle command."""
    idle, fields = actuator.actuator.idle, field_bounds(actuator.actuator)
    if winner is None:
        return ActuatorDecision(None, idle, None, ())
    if not values[winner.known]:
        return ActuatorDecision(winner.module, idle, "missing", (("missing", winner.module),))
    command = tuple([values[i] for i in winner.fields])
    limits = tuple(
        (limit.field_index, limit.relation == "<=", values[limit.bound] if values[limit.known] else None)
        for limit in actuator.limits
        if values[limit.applies]
    )
    fault, sent, records = settle(actuator.actuator.name, winner.module, command, fields, limits, idle, ())
    return ActuatorDecision(winner.module, sent, fault, records, fault is None)


def decide_given(actuator: Actuator, given: Given) -> ActuatorDecision:
    """Return the decision for an actuator that was given something else than the network decided."""
    if given.values is None:
        return ActuatorDecision(None, actuator.idle, None, ())
    return ActuatorDecision(None, given.values, None, (), is_commanded=True)


def field_bounds(actuator: Actuator) -> tuple[tuple[str, float, float | None, float | None], ...]:
    """Return name, factor, low and high of each field, as `settle` expects them."""
    return tuple((f.name, f.factor, f.low, f.high) for f in actuator.fields)
