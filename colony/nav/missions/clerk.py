"""The Navigator's clerk: handles the semaphores that a compiled network does not know.

The Planner's $GoalData becomes a GoalNumber, one higher for each goal. When the network reports in
GoalReached that it has reached this very goal, $RobotStatus is upped (thesis section 5.3). A goal that
arrives while another one is pursued replaces it, and the old goal is never answered: its Planner is gone.

A restarted clerk resumes where the one before it ended: a goal that has its number and no answer is pursued,
and answered even if it was reached meanwhile. Only a goal that the old clerk held between $GoalData and
GoalNumber is lost: then the robot stands, and needs a new Planner.
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
"""Seconds between two checks whether the goal was reached: one frame."""

TRACKER_S = 1.0
"""Timeout for CTracker to notice new lights, in seconds."""


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
    """Wait until the goal is reached (True), or another one replaces it (False)."""
    while True:
        # Waiting for the next goal is the pause between two looks.
        if (yield from taken(GOAL_DATA, PERIOD_S)):
            return False
        if (yield from _value(GOAL_REACHED)) == number:
            return True


def _await_tracker() -> Generator[Step, Any, None]:
    """Hold back a goal of lights until CeilingLight no longer belongs to the goal before.

    CTracker sets it to 0 when it has taken its data. A network that saw the goal first would take the old
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
    """Return a variable, or None if it was never set."""
    told = yield from values(name)
    return None if told is None else told[name]
