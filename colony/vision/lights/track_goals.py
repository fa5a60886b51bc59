"""CTracker's goals at DServer, which it takes when $TrackData is upped, and resumes after a restart.

TrackStart holds the robot's position when a goal was taken, the reference of LightOffset. A tracker that
finds the TrackStart of an interrupted one resumes with the lights that CeilingLight does not count yet.
"""

from __future__ import annotations

from collections.abc import Generator
from itertools import accumulate
from typing import Any, NamedTuple

from colony.nav.calls import read_variables, try_wait
from colony.nav.shared import (
    CEILING_LIGHT,
    END_L_MODE,
    GOAL_DIRECTION,
    GOAL_DISTANCE,
    GOAL_TYPE,
    LIGHT_OFFSET,
    TRACK_DATA,
    TRACK_START,
    GoalKind,
)
from colony.runtime.kit.script import Step, do
from colony.runtime.library import data, robot
from colony.vision.lights.track import LightGoal

_GOAL_VARIABLES = (GOAL_DISTANCE, LIGHT_OFFSET, GOAL_DIRECTION)


class UnfinishedGoal(NamedTuple):
    """An interrupted goal, and the number of its lights that were passed."""

    goal: LightGoal
    passed: int


def take_new_goal_signal() -> Generator[Step, Any, bool]:
    """Down $TrackData; return True if it was upped for a new goal."""
    return (yield from try_wait(TRACK_DATA, 0.0))


def take_goal() -> Generator[Step, Any, LightGoal]:
    """Take the goal that the Planner set, which begins at the robot's position; reset CeilingLight.

    Raises:
        ValueError: the number of offsets differs from the number of lights.
    """
    here = yield from do("RServer", robot.position())
    variables = yield from do("DServer", data.get_many(_GOAL_VARIABLES))
    goal = _goal(variables, here.x, here.y)
    if goal is None:
        raise ValueError(
            f"{GOAL_DISTANCE} is {variables[GOAL_DISTANCE]!r} and {LIGHT_OFFSET} "
            f"{variables[LIGHT_OFFSET]!r} when {TRACK_DATA} was upped; expected a list with an offset in mm "
            "for each light: set both before"
        )
    yield from do("DServer", data.set_many({CEILING_LIGHT: 0, TRACK_START: [here.x, here.y]}))
    return goal


def unfinished_goal() -> Generator[Step, Any, UnfinishedGoal | None]:
    """Return the goal of an interrupted tracker, or None if it was finished or abandoned."""
    variables = yield from read_variables(*_GOAL_VARIABLES, CEILING_LIGHT, TRACK_START)
    if variables is None or not variables[TRACK_START] or (yield from is_goal_abandoned()):
        return None
    goal = _goal(variables, *variables[TRACK_START])
    passed = int(variables[CEILING_LIGHT])
    if goal is None:
        return None
    if passed >= len(goal.lights_mm):
        yield from end_goal()  # possibly for the second time: the Planner discards duplicates
        return None
    return UnfinishedGoal(goal, passed)


def end_goal() -> Generator[Step, Any, None]:
    """Notify the Planner that the last light was passed; Overshoot must already be set."""
    yield from do("DServer", data.signal(END_L_MODE))
    yield from abandon_goal()


def abandon_goal() -> Generator[Step, Any, None]:
    """Clear TrackStart, so that the current goal is not resumed."""
    yield from do("DServer", data.set(TRACK_START, []))


def is_goal_abandoned() -> Generator[Step, Any, bool]:
    """Return True if the robot has a new goal of another kind: no client waits for these lights anymore.

    GoalType NONE only halts the robot.
    """
    variables = yield from read_variables(GOAL_TYPE)
    return variables is not None and variables[GOAL_TYPE] not in (GoalKind.LIGHTS, GoalKind.NONE)


def _goal(variables: dict[str, Any], x_mm: float, y_mm: float) -> LightGoal | None:
    count, offsets = variables[GOAL_DISTANCE], variables[LIGHT_OFFSET]
    if not isinstance(offsets, list) or len(offsets) != count:
        return None
    return LightGoal(
        direction_deg=float(variables[GOAL_DIRECTION]),
        x_mm=x_mm,
        y_mm=y_mm,
        lights_mm=tuple(accumulate(float(offset) for offset in offsets)),
    )
