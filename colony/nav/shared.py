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

CTracker also reads GoalDirection, along which the lights give the position, and GoalType. A Planner that
starts downs the semaphores that an earlier Planner upped and no client took.

Three more variables belong to the Navigator alone: GoalNumber, GoalReached and GoalAnswered. It is a compiled
network, which knows variables and no semaphores, and a clerk that takes and gives these in its place
(`colony/nav/missions/clerk.py`). TrackStart is CTracker's own (`colony/vision/lights/track_goals.py`).
"""

from __future__ import annotations

from enum import IntEnum

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
"""A list in millimeters: from where the goal was given to the first light, then from light to light."""

CEILING_LIGHT = "CeilingLight"
"""Number of lights of the present goal that were passed."""

OVERSHOOT = "Overshoot"
"""Distance beyond the last light when CTracker was done, in millimeters along GoalDirection."""

GOAL_NUMBER = "GoalNumber"
"""Set by the clerk: counts the goals taken, from 1. The network measures a goal's distance from where the
robot was when this changed."""

GOAL_REACHED = "GoalReached"
"""Set by the network: the GoalNumber of the goal that it has reached."""

GOAL_ANSWERED = "GoalAnswered"
"""Set by the clerk: the GoalNumber of the last goal for which it upped $RobotStatus."""

TRACK_START = "TrackStart"
"""Set by CTracker: where the robot was when a goal of lights was taken, x and y in mm; an empty list when its
last light was passed."""

FLOOR = "Floor"
"""Set by the Planner: the name of the map of the floor that the robot is on."""

POSE = "Pose"
"""Set by the pose estimator (`colony/nav/pose/estimate.py`): where the robot is, as far as all sources know
together, and how sure that is."""

LIGHT_FIX = "LightFix"
"""Set by CTracker at each valid light: a `Fix` (`colony/nav/pose/fixes.py`) as a list."""

PLATE_FIX = "PlateFix"
"""Set by the plate finder at each plate that it knows from the map: likewise."""

MARKER_FIX = "MarkerFix"
"""Set by the marker finder: likewise."""

PLATE_SEEN = "PlateSeen"
"""Set by the plate finder at each new plate: a list of the time in nanoseconds, the number of plates so far,
what is written on it, and where its middle is, x and y in mm."""

GOAL_VERIFIED = "GoalVerified"
"""Set by the Planner at the end of a plan with a plate to verify.

A `Verdict` (`colony/nav/missions/goal_verification.py`) as a number.
"""

MARKER_BEARING = "MarkerBearing"
"""Set by the marker finder: where the elevator's marker is seen, in degrees counterclockwise from ahead."""

MARKER_FACING = "MarkerFacing"
"""Set with it: how far the robot has to turn to face the doors squarely, in degrees counterclockwise."""

MARKER_DISTANCE = "MarkerDistance"
"""Set with it: how far the robot's middle is from the marker's, in mm."""

ELEVATOR_CALL = "ElevatorCall"
"""Set by the Planner before a ride: a list of the elevator's node, the name of the map of this floor and of
the other one. Empty when the ride is over."""

FLOOR_REACHED = "FloorReached"
"""Set by the operator of the buttons: 1 when the elevator stands at the other floor, else 0."""


class GoalKind(IntEnum):
    """The modes of the Navigator; the number is the letter's code (thesis Table 5.2)."""

    NONE = 0  # stand
    CORNER = ord("C")  # Leave-Corner: turn to GoalDirection and leave the turning space
    DEAD_RECKONING = ord("D")  # to the goal, by distance
    ENTER_CORNER = ord("E")  # to the middle of a turning space
    LIGHTS = ord("L")  # Ceiling-Light Tracking
    ELEVATOR = ord("V")  # in through an elevator's doors, turn around, and out again
