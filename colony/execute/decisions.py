"""What an actuator is sent once its winner is known."""

from __future__ import annotations

from typing import Any, NamedTuple

from colony.execute.code import ActuatorCode, ClientCode
from colony.execute.settle import leave, settle
from colony.ir.program import Actuator
from colony.ir.types import ScalarValue

Records = tuple[tuple[str, str], ...]


class Decided(NamedTuple):
    """A decision: `sent` in base units, `leaving` in declared units, both None where nothing is sent."""

    by: str | None
    sent: tuple[ScalarValue, ...] | None
    leaving: tuple[ScalarValue, ...] | None
    fault: str | None
    records: Records


def decide(actuator: ActuatorCode, winner: ClientCode | None, values: list[Any]) -> Decided:
    """What an actuator is sent when `winner` has won: its command, bounded, or the idle one."""
    idle, fields = actuator.actuator.idle, field_bounds(actuator.actuator)
    if winner is None:
        return Decided(None, idle, None if idle is None else leave(idle, fields), None, ())
    command = tuple([values[i] for i in winner.fields])
    limits = tuple(
        (limit.field_index, limit.relation == "<=", values[limit.bound])
        for limit in actuator.limits
        if values[limit.applies]
    )
    decision, sent, records = settle(actuator.actuator.name, winner.module, command, fields, limits, idle, ())
    _, by, leaving, fault = decision
    return Decided(by, sent, leaving, fault, records)


def field_bounds(actuator: Actuator) -> tuple[tuple[str, float, float | None, float | None], ...]:
    """The fields as `settle` takes them."""
    return tuple((f.name, f.factor, f.low, f.high) for f in actuator.fields)
