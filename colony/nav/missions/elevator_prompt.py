"""The operator of a real elevator's buttons: a person at the terminal (thesis section 5.4.6).

The robot sees by itself when the doors open before it. Inside, metal walls dazzle it: the operator presses
Enter when the elevator is at the other floor and its doors are open.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, Protocol

from colony.nav.maps.building import Building
from colony.nav.maps.signs import door_name
from colony.nav.missions.elevator_calls import Call, called
from colony.nav.shared import FLOOR_REACHED
from colony.runtime.kit.script import Script, do, sleep
from colony.runtime.library import data

LOOK_S = 0.2
"""Seconds between two checks whether Enter was pressed."""

Heard = Literal["line", "nothing", "end"]
"""A line was entered, none was so far, or there will be none."""


class Ear(Protocol):
    """A nonblocking reader of what the operator enters."""

    def forget(self) -> None:
        """Discard what was typed before a question: it is no answer to it."""

    def listen(self) -> Heard:
        """Return what was entered since the last call, a line at a time."""


def elevator_prompt(building: Building, ear: Ear, *, say: Callable[[str], None]) -> Script:
    """Ask for the buttons of each elevator that the robot calls, and pass on that its floor is reached.

    Without an operator, the robot goes by what it sees of the doors alone. Never ends.

    Args:
        building: the building, which gives the floors their names.
        ear: reads the answers.
        say: shows a line to the operator.
    """
    answers = True
    while True:
        yield from do("DServer", data.set(FLOOR_REACHED, int(not answers)))
        while (call := (yield from called())) is None:
            yield from sleep(LOOK_S)
        say(asked_for(building, call))
        told = False
        if answers:
            ear.forget()
            say(f"Press Enter here when its doors are open on {_floor(building, call.other)}.")
        while (yield from called()) == call:
            heard = ear.listen() if answers and not told else "nothing"
            if heard == "end":
                answers = False
                say("Nobody can answer here: the robot goes out when it sees the doors open.")
            if heard != "nothing":
                told = True
                yield from do("DServer", data.set(FLOOR_REACHED, 1))
            yield from sleep(LOOK_S)


def asked_for(building: Building, call: Call) -> str:
    """Return the instructions to the operator for a call."""
    where, other = _floor(building, call.floor), _floor(building, call.other)
    button = f"Press the button of the elevator {door_name(call.node)} on {where}{_way(building, call)}"
    return f"{button}. When the robot has turned around inside, press that of {other}."


def _floor(building: Building, name: str) -> str:
    return f"floor {building.map_named(name).floor}"


def _way(building: Building, call: Call) -> str:
    """Return which of two buttons it is, if floors have numbers."""
    here, there = (building.map_named(name).floor for name in (call.floor, call.other))
    try:
        return ", up" if int(there) > int(here) else ", down"
    except ValueError:
        return ""
