"""The Navigator's clerk: handles the semaphores, which a compiled network cannot use.

For each $GoalData of the Planner the clerk increments GoalNumber. When the network reports that number in
GoalReached, the clerk ups $RobotStatus (thesis section 5.3). A goal that arrives during the pursuit of
another one replaces it; the old goal is never answered, as its Planner no longer runs.

A restarted clerk resumes where its predecessor stopped: a goal with a number and no answer is still pursued,
and is answered even if the robot reached it in the meantime. A goal is lost only if the clerk dies between
$GoalData and GoalNumber: the robot then stands still and needs a new Planner.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

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
    read_variables,
    try_wait,
)
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import data

PERIOD_S = 0.05
"""Seconds between two checks whether the goal was reached: one frame."""

TRACKER_TIMEOUT_S = 1.0
"""Timeout for CTracker to notice new lights, in seconds."""


def clerk() -> Script:
    """Pass goals from the Planner to the network, and the network's answers back, forever."""
    for name in (GOAL_DATA, ROBOT_STATUS):
        yield from do("DServer", data.create_semaphore(name, 0))
    number = int((yield from _read_variable(GOAL_NUMBER)) or 0)
    is_pursuing = number != int((yield from _read_variable(GOAL_ANSWERED)) or 0)
    while True:
        if is_pursuing and (yield from _await_goal(number)):
            # In this order: the Planner discards a duplicate answer, but waits forever for a lost one.
            yield from do("DServer", data.signal(ROBOT_STATUS))
            yield from do("DServer", data.set(GOAL_ANSWERED, number))
            is_pursuing = False
        if not is_pursuing:
            yield from do("DServer", data.wait(GOAL_DATA))
        yield from _await_tracker()
        number += 1
        yield from do("DServer", data.set(GOAL_NUMBER, number))
        is_pursuing = True


def _await_goal(number: int) -> Generator[Step, Any, bool]:
    """Wait until the goal is reached, and return True; return False if another goal replaces it."""
    while True:
        # The wait for the next goal is the pause between two checks.
        if (yield from try_wait(GOAL_DATA, PERIOD_S)):
            return False
        if (yield from _read_variable(GOAL_REACHED)) == number:
            return True


def _await_tracker() -> Generator[Step, Any, None]:
    """Hold back a goal of lights while CeilingLight still counts the lights of the previous goal.

    CTracker resets the count when it takes the new goal. A network that saw the goal earlier would compare it
    with the old count, and report it as reached.
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


def _read_variable(name: str) -> Generator[Step, Any, Any]:
    """Return the value of a variable, or None if it was never set."""
    variables = yield from read_variables(name)
    return None if variables is None else variables[name]
