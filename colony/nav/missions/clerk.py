"""The Navigator's clerk: takes and gives the semaphores that a compiled network does not know.

The Planner's $GoalData becomes a GoalNumber, one higher for each goal, and when the network says in
GoalReached that it has reached this very goal, $RobotStatus is upped (thesis section 5.3). A goal that comes
while another one is pursued takes its place, and the other one is never answered: its Planner is gone.

A clerk that is started anew goes on where one before it was ended: a goal that has its number and no answer
is pursued, and answered even if it was reached meanwhile. Only a goal that it held between $GoalData and
GoalNumber is lost: then the robot stands, and wants a new Planner.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

from colony.nav.asks import taken, values
from colony.nav.shared import (
    CEILING_LIGHT,
    GOAL_ANSWERED,
    GOAL_DATA,
    GOAL_DISTANCE,
    GOAL_NUMBER,
    GOAL_REACHED,
    GOAL_TYPE,
    ROBOT_STATUS,
    GoalKind,
)
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import data

PERIOD_S = 0.05
"""How often it is asked whether the goal was reached: once a frame."""

TRACKER_S = 1.0
"""For how long CTracker has time to take notice of new lights."""


def clerk() -> Script:
    """Hand goals from the Planner to the network and its answers back; never ends."""
    for name in (GOAL_DATA, ROBOT_STATUS):
        yield from do("DServer", data.create_semaphore(name, 0))
    number = int((yield from _value(GOAL_NUMBER)) or 0)
    pursued = number != int((yield from _value(GOAL_ANSWERED)) or 0)
    while True:
        if pursued and (yield from _reached(number)):
            # In this order: the Planner throws away one answer too many, and waits for ever for one lost.
            yield from do("DServer", data.signal(ROBOT_STATUS))
            yield from do("DServer", data.set(GOAL_ANSWERED, number))
            pursued = False
        if not pursued:
            yield from do("DServer", data.wait(GOAL_DATA))
        yield from _await_tracker()
        number += 1
        yield from do("DServer", data.set(GOAL_NUMBER, number))
        pursued = True


def _reached(number: int) -> Generator[Step, Any, bool]:
    """Until the goal is reached (True), or there is another one in its place (False)."""
    while True:
        # Waiting for the next goal is the pause between two looks.
        if (yield from taken(GOAL_DATA, PERIOD_S)):
            return False
        if (yield from _value(GOAL_REACHED)) == number:
            return True


def _await_tracker() -> Generator[Step, Any, None]:
    """Where lights are the goal, hold it back until CeilingLight is not that of the goal before.

    CTracker sets it to 0 when it has taken its data, and a network that saw the goal first would take the old
    count for the new one, and the goal for reached.
    """
    told = yield from values(GOAL_TYPE, GOAL_DISTANCE, CEILING_LIGHT)
    if told is None or told[GOAL_TYPE] != GoalKind.LIGHTS:
        return
    begun_ns = now_ns = yield from sleep(0.0)
    while told[CEILING_LIGHT] >= told[GOAL_DISTANCE] and now_ns - begun_ns < TRACKER_S * 1e9:
        now_ns = yield from sleep(PERIOD_S)
        told[CEILING_LIGHT] = yield from do("DServer", data.get(CEILING_LIGHT))


def _value(name: str) -> Generator[Step, Any, Any]:
    """A variable, or None where it was never set."""
    told = yield from values(name)
    return None if told is None else told[name]
