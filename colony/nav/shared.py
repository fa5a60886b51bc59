"""Variables and semaphores that the navigation clients share through DServer (thesis Table 5.4).

| name          | Planner | Navigator | CTracker | LocalMapper |
|---------------|---------|-----------|----------|-------------|
| $StartMap     | up      |           |          | down        |
| $LightDet     |         |           | up       | down        |
| $GoalData     | up      | down      |          |             |
| $RobotStatus  | down    | up        |          |             |
| $TrackData    | up      |           | down     |             |
| $EndLMode     | down    |           | up       |             |
| GoalDirection | write   | read      |          | read        |
| GoalDistance  | write   | read      | read     | read        |
| GoalType      | write   | read      |          |             |
| LightOffset   | write   |           | read     |             |
| CeilingLight  |         | read      | write    | read        |
| Overshoot     | read    |           | write    |             |

CTracker also reads GoalType, and GoalDirection, the axis along which the lights give the position. A Planner
that starts first downs the semaphores that an earlier Planner upped and no client downed.

Three more variables belong to the Navigator alone: GoalNumber, GoalReached and GoalAnswered. The Navigator is
a compiled network, which has access to variables only, and a clerk that handles the semaphores for it
(`colony/nav/missions/clerk.py`). TrackStart is CTracker's own (`colony/vision/lights/track.py`).
"""

from __future__ import annotations

from collections.abc import Generator
from enum import IntEnum
from typing import Any, TypeVar

from colony.runtime.kit.errors import CallRefusedError, RobotConnectionError
from colony.runtime.kit.script import Step, do
from colony.runtime.library import data, robot
from colony.runtime.library.ask import CallRequest

# --- calls ---------------------------------------------------------------------------------------------
#
# Calls of the navigation scripts to servers that may not be able to answer yet.
#
# A semaphore may be 0, a variable unset, a server unreachable or without a value.


T = TypeVar("T")

_NOT_YET = ("no value", "unknown", "unset")
"""Refusal codes of servers that have no answer yet."""


def try_wait(semaphore: str, wait_s: float) -> Generator[Step, Any, bool]:
    """Down a semaphore; return False if it stays 0 for `wait_s` seconds.

    Raises:
        CallRefusedError: there is no such semaphore.
    """
    try:
        yield from do("DServer", data.wait(semaphore, timeout_s=wait_s))
    except CallRefusedError as refused:
        if refused.code != "timeout":
            raise
        return False
    return True


def read_variables(*names: str) -> Generator[Step, Any, dict[str, Any] | None]:
    """Return a consistent snapshot of variables, or None if one of them was never set."""
    try:
        return (yield from do("DServer", data.get_many(names)))
    except CallRefusedError as refused:
        if refused.code not in ("unknown", "unset"):
            raise
        return None


def try_ask(server: str, ask: CallRequest[T]) -> Generator[Step, Any, T | None]:
    """Return a server's answer, or None while the server is unreachable or has no value yet.

    Raises:
        CallRefusedError: the server refuses the request, and always will.
    """
    try:
        return (yield from do(server, ask))
    except RobotConnectionError as problem:
        _raise_if_final(problem)
        return None


def try_adjust_position(x_mm: float, y_mm: float, turn_deg: float) -> Generator[Step, Any, bool]:
    """Correct RServer's position; return False if RServer is unreachable.

    Raises:
        CallRefusedError: RServer refuses the correction, and always will.
    """
    try:
        yield from do("RServer", robot.adjust_position(x_mm, y_mm, turn_deg))
    except RobotConnectionError as problem:
        _raise_if_final(problem)
        return False
    return True


def _raise_if_final(problem: RobotConnectionError) -> None:
    """Raise a final refusal; ignore other connection problems, as a dead server is restarted."""
    if isinstance(problem, CallRefusedError) and problem.code not in _NOT_YET:
        raise problem


# --- shared --------------------------------------------------------------------------------------------


START_MAP = "$StartMap"
LIGHT_DETECTED = "$LightDet"
GOAL_DATA = "$GoalData"
ROBOT_STATUS = "$RobotStatus"
TRACK_DATA = "$TrackData"
END_L_MODE = "$EndLMode"
SEMAPHORES = (START_MAP, LIGHT_DETECTED, GOAL_DATA, ROBOT_STATUS, TRACK_DATA, END_L_MODE)
"""All semaphores. They begin at 0; the first client that needs them creates them."""

GOAL_DIRECTION = "GoalDirection"
"""The heading along which to proceed, in degrees, 0 north, 90 west."""

GOAL_DISTANCE = "GoalDistance"
"""Number of lights to track in the light-tracking mode, else the distance to travel, in millimeters."""

GOAL_TYPE = "GoalType"
"""The mode: a `GoalKind` as a number."""

LIGHT_OFFSET = "LightOffset"
"""List of distances in mm: the first from the robot's position at the time the goal was set, to the first
light; the others from light to light."""

CEILING_LIGHT = "CeilingLight"
"""Number of lights of the current goal that the robot has passed."""

OVERSHOOT = "Overshoot"
"""Distance of the robot beyond the last light when CTracker finished, in mm along GoalDirection."""

GOAL_NUMBER = "GoalNumber"
"""Set by the clerk: the number of the current goal, from 1. The network measures a goal's distance from the
robot's position at the time of the change."""

GOAL_REACHED = "GoalReached"
"""Set by the network: the GoalNumber of the goal that it has reached."""

GOAL_ANSWERED = "GoalAnswered"
"""Set by the clerk: the GoalNumber of the last goal for which it upped $RobotStatus."""

TRACK_START = "TrackStart"
"""Set by CTracker: the robot's position when CTracker took a goal of lights, x and y in mm; an empty list
after the goal's last light."""

FLOOR = "Floor"
"""Set by the Planner: the name of the map of the robot's floor."""

POSE = "Pose"
"""Set by the pose estimator (`colony/nav/pose/estimate.py`): the fused estimate of the robot's pose, with its
covariance."""

LIGHT_FIX = "LightFix"
"""Set by CTracker at each valid light: a `Fix` (`colony/nav/pose/pose.py`) as a list."""

PLATE_FIX = "PlateFix"
"""Set by the plate finder at each observation of a plate of the map: a `Fix` as a list."""

MARKER_FIX = "MarkerFix"
"""Set by the marker finder at each observation of a marker of the map: a `Fix` as a list."""

PLATE_SEEN = "PlateSeen"
"""Set by the plate finder at each new plate: a list of the time in nanoseconds, the number of plates so far,
the plate's text, and the position of its center, x and y in mm."""

GOAL_VERIFIED = "GoalVerified"
"""Set by the Planner at the end of a plan with a plate to verify.

A `Verdict` (`colony/nav/missions/goal_verification.py`) as a number.
"""

MARKER_BEARING = "MarkerBearing"
"""Set by the marker finder: the bearing of the elevator's marker, in degrees counterclockwise from ahead."""

MARKER_FACING = "MarkerFacing"
"""Set with MarkerBearing: the turn that makes the robot face the doors squarely, in degrees
counterclockwise."""

MARKER_DISTANCE = "MarkerDistance"
"""Set with MarkerBearing: the distance between the centers of the robot and the marker, in mm."""

ELEVATOR_CALL = "ElevatorCall"
"""Set by the Planner before a ride: a list of the elevator's node, the name of the map of this floor and of
the other one. Empty after the ride."""

FLOOR_REACHED = "FloorReached"
"""Set by the operator of the buttons: 1 when the elevator has arrived at the other floor, else 0."""


class GoalKind(IntEnum):
    """The modes of the Navigator; the number is the letter's code (thesis Table 5.2)."""

    NONE = 0  # stand still
    CORNER = ord("C")  # Leave-Corner: turn to GoalDirection and leave the turning space
    DEAD_RECKONING = ord("D")  # to the goal, by distance
    ENTER_CORNER = ord("E")  # to the center of a turning space
    LIGHTS = ord("L")  # Ceiling-Light Tracking
    ELEVATOR = ord("V")  # in through an elevator's doors, turn around, and out again
