"""The decision for an actuator, given its winner."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

from colony.execute.code import ActuatorCode, ClientCode
from colony.execute.intake import Records
from colony.execute.settle import bounds_of, settle
from colony.ir.frame import OverriddenCommand, value_sent
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


class BoundsStep(NamedTuple):
    """The bounds of an actuator's fields in a frame, in base units.

    Attributes:
        low: Greatest lower bound of each field, None where it has none.
        high: Least upper bound of each field, None where it has none.
        fault: "limits contradict" if a lower bound is above an upper one; "bound missing" if a bound is not
            known and there is no idle command, whose value would stand in. No command may be sent then.
    """

    low: tuple[float | None, ...]
    high: tuple[float | None, ...]
    fault: Literal["limits contradict", "bound missing"] | None = None


def bounds_in_frame(actuator: ActuatorCode, values: list[Any]) -> BoundsStep:
    """Return the bounds of an actuator's fields: its ranges, and all limits that apply."""
    limits, idle = limits_in_frame(actuator, values), actuator.actuator.idle
    if idle is None and any(bound is None for _, _, bound in limits):
        return BoundsStep((), (), "bound missing")
    pairs = [bounds_of(i, f.low, f.high, limits, idle) for i, f in enumerate(actuator.actuator.fields)]
    if any(low is not None and high is not None and low > high for low, high in pairs):
        return BoundsStep((), (), "limits contradict")
    return BoundsStep(tuple([low for low, _ in pairs]), tuple([high for _, high in pairs]))


def limits_in_frame(actuator: ActuatorCode, values: list[Any]) -> tuple[tuple[int, bool, float | None], ...]:
    """Return the limits that apply, as `settle` expects them."""
    return tuple(
        [
            (limit.field_index, limit.relation == "<=", values[limit.bound] if values[limit.known] else None)
            for limit in actuator.limits
            if values[limit.applies]
        ]
    )


def decide(actuator: ActuatorCode, winner: ClientCode | None, values: list[Any]) -> ActuatorDecision:
    """Return the decision for an actuator: the winner's command, bounded, or the idle command."""
    idle, fields = actuator.actuator.idle, field_bounds(actuator.actuator)
    if winner is None:
        return ActuatorDecision(None, idle, None, ())
    if not values[winner.known]:
        return ActuatorDecision(winner.module, idle, "missing", (("missing", winner.module),))
    command = tuple([values[i] for i in winner.fields])
    limits = limits_in_frame(actuator, values)
    fault, sent, records = settle(actuator.actuator.name, winner.module, command, fields, limits, idle, ())
    return ActuatorDecision(winner.module, sent, fault, records, fault is None)


def decide_given(actuator: ActuatorCode, given: OverriddenCommand, values: list[Any]) -> ActuatorDecision:
    """Return the decision for an actuator that was given something else than the network decided."""
    idle, fields = actuator.actuator.idle, actuator.actuator.fields
    if given.values is None:
        return ActuatorDecision(None, idle, None, ())
    limits = limits_in_frame(actuator, values)
    sent = []
    for i, (field, value) in enumerate(zip(fields, given.values, strict=True)):
        known = idle is not None or all(bound is not None for at, _, bound in limits if at == i)
        low, high = bounds_of(i, field.low, field.high, limits, idle) if known else (None, None)
        sent.append(value_sent(value, field.factor, low, high))
    return ActuatorDecision(None, tuple(sent), None, (), is_commanded=True)


def field_bounds(actuator: Actuator) -> tuple[tuple[str, float, float | None, float | None], ...]:
    """Return name, factor, low and high of each field, as `settle` expects them."""
    return tuple((f.name, f.factor, f.low, f.high) for f in actuator.fields)
