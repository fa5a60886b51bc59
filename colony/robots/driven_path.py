"""The driven path of a robot, for plotting, with a bounded number of points for a run of any length."""

from __future__ import annotations

import math

MAX_POINTS = 10_000
"""Maximum number of points; beyond it every second point is dropped."""

SPACING_MM = 10.0
"""Initial distance between two points in mm; it doubles each time points are dropped."""


class DrivenPath:
    """A path with bounded memory. Mutable; the last point is always the newest position."""

    def __init__(self, *, max_points: int = MAX_POINTS) -> None:
        self._max_points = max_points
        self._spacing_mm = SPACING_MM
        self.points: list[tuple[float, float]] = []

    def add(self, x_mm: float, y_mm: float) -> None:
        """Add the robot's current position, in mm."""
        points = self.points
        if len(points) > 1 and math.dist(points[-2], (x_mm, y_mm)) < self._spacing_mm:
            points.pop()
        points.append((x_mm, y_mm))
        if len(points) > self._max_points:
            del points[1:-1:2]
            self._spacing_mm *= 2.0
