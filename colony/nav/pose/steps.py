"""Motion of the robot by its odometry: from moment to moment, and since a past moment."""

from __future__ import annotations

from typing import NamedTuple


class Step(NamedTuple):
    """A motion of the robot in its own frame at the beginning.

    Ahead and to the left in mm, turned in radians counterclockwise.
    """

    ahead_mm: float
    left_mm: float
    turned_rad: float


class Since(NamedTuple):
    """The motion of the robot since a moment, in its own frame of now.

    Ahead and to the left in mm, turned in radians counterclockwise, and the length of the way.
    """

    ahead_mm: float
    left_mm: float
    turned_rad: float
    way_mm: float


NOW = Since(0.0, 0.0, 0.0, 0.0)
