"""Elevator calls: the Planner's messages to the operator of an elevator's buttons (thesis section 5.4.6)."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, NamedTuple

from colony.nav.asks import values
from colony.nav.shared import ELEVATOR_CALL
from colony.runtime.kit.script import Step


class Call(NamedTuple):
    """The node of the elevator's doors, and the names of the maps of the robot's floor and of the other."""

    node: str
    floor: str
    other: str


def call_of(told: object) -> Call | None:
    """Return the call in a value of ElevatorCall, or None if it is none."""
    if isinstance(told, (list, tuple)) and len(told) == 3 and all(isinstance(word, str) for word in told):
        return Call(*told)
    return None


def called() -> Generator[Step, Any, Call | None]:
    """Return the present call at DServer, or None."""
    told = yield from values(ELEVATOR_CALL)
    return None if told is None else call_of(told[ELEVATOR_CALL])
