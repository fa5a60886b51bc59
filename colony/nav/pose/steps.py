"""Motion of the robot by its odometry: in one step, and since a past time."""

from __future__ import annotations

from typing import NamedTuple


class Step(NamedTuple):
    """A motion of the robot in its frame at the start.

    Distances ahead and to the left in mm, and the turn in radians counterclockwise.
    """

    ahead_mm: float
    left_mm: float
    turned_rad: float


class MotionSince(NamedTuple):
    """The motion of the robot since a past time, in its current frame.

    Distances ahead and to the left in mm, the turn in radians counterclockwise, and the distance traveled in
    mm.
    """

    ahead_mm: float
    left_mm: float
    turned_rad: float
    travel_mm: float


NO_MOTION = MotionSince(0.0, 0.0, 0.0, 0.0)
