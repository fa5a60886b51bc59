"""Elevator calls: the Planner's messages to the operator of an elevator's buttons (thesis section 5.4.6)."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, NamedTuple

from colony.nav.calls import read_variables
from colony.nav.shared import ELEVATOR_CALL
from colony.runtime.kit.script import Step


class ElevatorCall(NamedTuple):
    """A call: the node of the elevator's doors, the map of the robot's floor, and that of the other floor."""

    node: str
    floor: str
    destination: str


def decode_elevator_call(value: object) -> ElevatorCall | None:
    """Decode a value of ElevatorCall; None if it is not a call."""
    if isinstance(value, (list, tuple)) and len(value) == 3 and all(isinstance(word, str) for word in value):
        return ElevatorCall(*value)
    return None


def current_call() -> Generator[Step, Any, ElevatorCall | None]:
    """Return the current call at DServer, or None if there is none."""
    variables = yield from read_variables(ELEVATOR_CALL)
    return None if variables is None else decode_elevator_call(variables[ELEVATOR_CALL])
