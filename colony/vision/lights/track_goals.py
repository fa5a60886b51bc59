"""The goals of CTracker at DServer: taken when $TrackData is upped, and resumed by a restarted tracker.

TrackStart holds the robot's place when a goal was taken, since LightOffset counts from there. So a tracker
that finds the TrackStart of an interrupted one resumes with the lights that CeilingLight does not count yet.
"""

from __future__ import annotations

from collections.abc import Generator
from itertools import accumulate
from typing import Any, NamedTuple

from colony.nav.asks import taken, values
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

_TOLD = (GOAL_DISTANCE, LIGHT_OFFSET, GOAL_DIRECTION)


class Unfinished(NamedTuple):
    """A goal of which so many lights were passed."""

    goal: LightGoal
    passed: int


def new_goal() -> Generator[Step, Any, bool]:
    """Return True if $TrackData is upped, and so there is another goal."""
    return (yield from taken(TRACK_DATA, 0.0))


def take_goal() -> Generator[Step, Any, LightGoal]:
    """Return the goal that the Planner set, from where the robot is; CeilingLight counts from 0 for it.

    Raises:
        ValueError: there is not an offset for each light.
    """
    here = yield from do("RServer", robot.position())
    told = yield from do("DServer", data.get_many(_TOLD))
    goal = _goal(told, here.x, here.y)
    if goal is None:
        raise ValueError(
            f"{GOAL_DISTANCE} is {told[GOAL_DISTANCE]!r} and {LIGHT_OFFSET} {told[LIGHT_OFFSET]!r} where "
            f"{TRACK_DATA} was upped; expected a list with an offset in mm for each light: set both before"
        )
    yield from do("DServer", data.set_many({CEILING_LIGHT: 0, TRACK_START: [here.x, here.y]}))
    return goal


def unfinished_goal() -> Generator[Step, Any, Unfinished | None]:
    """Return the goal of a tracker that was ended before its last light, if it is still meant."""
    told = yield from values(*_TOLD, CEILING_LIGHT, TRACK_START)
    if told is None or not told[TRACK_START] or (yield from is_given_up()):
        return None
    goal = _goal(told, *told[TRACK_START])
    passed = int(told[CEILING_LIGHT])
    if goal is None:
        return None
    if passed >= len(goal.lights_mm):
        yield from end_goal()  # perhaps once more: the Planner throws away what is too many
        return None
    return Unfinished(goal, passed)


def end_goal() -> Generator[Step, Any, None]:
    """Notify the Planner that the last light was passed; Overshoot is set."""
    yield from do("DServer", data.signal(END_L_MODE))
    yield from give_up()


def give_up() -> Generator[Step, Any, None]:
    """Return the present goal is not to be taken up again."""
    yield from do("DServer", data.set(TRACK_START, []))


def is_given_up() -> Generator[Step, Any, bool]:
    """Return True if the robot has a new goal of another kind: no client waits for these lights any more.

    GoalType NONE gives nothing up: it only halts the robot.
    """
    told = yield from values(GOAL_TYPE)
    return told is not None and told[GOAL_TYPE] not in (GoalKind.LIGHTS, GoalKind.NONE)


def _goal(told: dict[str, Any], x_mm: float, y_mm: float) -> LightGoal | None:
    count, offsets = told[GOAL_DISTANCE], told[LIGHT_OFFSET]
    if not isinstance(offsets, list) or len(offsets) != count:
        return None
    return LightGoal(
        direction_deg=float(told[GOAL_DIRECTION]),
        x_mm=x_mm,
        y_mm=y_mm,
        lights_mm=tuple(accumulate(float(offset) for offset in offsets)),
    )
