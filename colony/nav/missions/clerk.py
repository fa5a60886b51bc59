"""The Navigator's clerk: handles the semaphores, which a compiled network cannot use.

For each $GoalData of the Planner the clerk increments GoalNumber. When the network reports that number in
GoalReached, the clerk ups $RobotStatus (thesis section 5.3). A goal that arrives while another one is pursued
replaces it, and the old goal is never answered: its Planner is gone.

A restarted clerk resumes where its predecessor ended: a goal with a number and no answer is still pursued,
and answered even if it was reached meanwhile. Only a goal between $GoalData and GoalNumber is lost: the robot
stands then, and needs a new Planner.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

from colony.nav.calls import read_variables, try_wait
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

TRACKER_TIMEOUT_S = 1.0
"""Timeout for CTracker to notice new lights, in seconds."""


def clerk() -> Script:
    """Pass goals from the Planner to the network, and the network's answers back; never ends."""
    for name in (GOAL_DATA, ROBOT_STATUS):
        yield from do("DServer", data.create_semaphore(name, 0))
    number = int((yield from _value(GOAL_NUMBER)) or 0)
    pursued = number != int((yield from _value(GOAL_ANSWERED)) or 0)
    while True:
        if pursued and (yield from _reached(number)):
            # In this order: the Planner discards a duplicate answer, but waits forever for a lost one.
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
        # The wait for the next goal is the pause between two checks.
        if (yield from try_wait(GOAL_DATA, PERIOD_S)):
            return False
        if (yield from _value(GOAL_REACHED)) == number:
            return True


def _await_tracker() -> Generator[Step, Any, None]:
    """Hold back a goal of lights while CeilingLight still counts those of the previous goal.

    CTracker resets the count when it takes the new goal. A network that saw the goal before would take the
    old count for the new one, and report the goal as reached.
    """
    variables = yield from read_variables(GOAL_TYPE, GOAL_DISTANCE, CEILING_LIGHT)
    if variables is None or variables[GOAL_TYPE] != GoalKind.LIGHTS:
        return
    start_ns = now_ns = yield from sleep(0.0)
    while (
        variables[CEILING_LIGHT] >= variables[GOAL_DISTANCE] and now_ns - start_ns < TRACKER_TIMEOUT_S * 1e9
    ):
        now_ns = yield from sleep(PERIOD_S)
        variables[CEILING_LIGHT] = yield from do("DServer", data.get(CEILING_LIGHT))


def _value(name: str) -> Generator[Step, Any, Any]:
    """Return a variable, or None if it was never set."""
    variables = yield from read_variables(name)
    return None if variables is None else variables[name]
