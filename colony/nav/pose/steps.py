"""How a robot moves, as its odometry tells: from moment to moment, and since a while ago."""

from __future__ import annotations

from typing import NamedTuple


class Step(NamedTuple):
    """How a robot moved, in its own frame at the beginning: ahead and to the left in mm, turned in radians
    counterclockwise.
    """

    ahead_mm: float
    left_mm: float
    turned_rad: float


class Since(NamedTuple):
    """How a robot moved since a moment, in its own frame of now: ahead and to the left in mm, turned in
    radians counterclockwise; and how long its way was.
    """

    ahead_mm: float
    left_mm: float
    turned_rad: float
    way_mm: float


NOW = Since(0.0, 0.0, 0.0, 0.0)
