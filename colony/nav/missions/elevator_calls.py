"""Elevator calls: the Planner's messages to the operator of an elevator's buttons (thesis section 5.4.6)."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any, Literal, NamedTuple, Protocol

from colony.nav.maps.building import Building
from colony.nav.maps.signs import door_name
from colony.nav.shared import ELEVATOR_CALL, FLOOR_REACHED, read_variables
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import data

# --- elevator calls ------------------------------------------------------------------------------------


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


# --- elevator prompt -----------------------------------------------------------------------------------
#
# The operator of a real elevator's buttons: a person at the terminal (thesis section 5.4.6).
#
# The robot's sonars detect the doors opening in front of it. Inside, metal walls confuse them, so the
# operator presses Enter when the elevator is at the other floor and its doors are open.


POLL_INTERVAL_S = 0.2
"""Seconds between two polls for Enter."""

PollResult = Literal["line", "nothing", "end"]
"""Result of a poll: a line was entered, no line was entered yet, or the input has ended."""


class LineInput(Protocol):
    """A nonblocking reader of the lines that the operator enters."""

    def discard(self) -> None:
        """Discard the lines typed so far."""

    def poll(self) -> PollResult:
        """Consume the next line, if one was entered."""


def elevator_prompt(building: Building, line_input: LineInput, *, say: Callable[[str], None]) -> Script:
    """Ask the operator to press the buttons of each elevator that the robot calls, and report its arrival.

    Without an operator, the robot relies on its sonars alone. The script never ends.

    Args:
        building: the building, for the names of its floors.
        line_input: source of the answers.
        say: callback that shows a line to the operator.
    """
    can_answer = True
    while True:
        yield from do("DServer", data.set(FLOOR_REACHED, int(not can_answer)))
        while (call := (yield from current_call())) is None:
            yield from sleep(POLL_INTERVAL_S)
        say(instructions(building, call))
        reached = False
        if can_answer:
            line_input.discard()
            say(f"Press Enter here when its doors are open on {_floor(building, call.destination)}.")
        while (yield from current_call()) == call:
            poll_result = line_input.poll() if can_answer and not reached else "nothing"
            if poll_result == "end":
                can_answer = False
                say("No answers can be read here: the robot leaves when it detects the open doors.")
            if poll_result != "nothing":
                reached = True
                yield from do("DServer", data.set(FLOOR_REACHED, 1))
            yield from sleep(POLL_INTERVAL_S)


def instructions(building: Building, call: ElevatorCall) -> str:
    """Return the instructions to the operator for a call."""
    here, destination = _floor(building, call.floor), _floor(building, call.destination)
    button = f"Press the button of the elevator {door_name(call.node)} on {here}{_direction(building, call)}"
    return f"{button}. When the robot has turned around inside, press the one for {destination}."


def _floor(building: Building, name: str) -> str:
    return f"floor {building.map_named(name).floor}"


def _direction(building: Building, call: ElevatorCall) -> str:
    """Return the direction of the ride, or "" if the floors are not numbered."""
    here, there = (building.map_named(name).floor for name in (call.floor, call.destination))
    try:
        return ", up" if int(there) > int(here) else ", down"
    except ValueError:
        return ""
