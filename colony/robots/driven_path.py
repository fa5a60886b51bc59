"""Paths of robots and people, for plotting, with a bounded number of points for a run of any length."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

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


Paths = tuple[tuple[tuple[float, float], ...], ...]
"""The points of several paths, in mm."""

MAX_POINTS_OF_PEOPLE = 300
"""Maximum number of points of the path of a person, who walks up and down one straight line."""


class PeoplePaths:
    """The paths of the people on each floor. Mutable."""

    def __init__(self) -> None:
        self._paths: dict[str, list[DrivenPath]] = {}

    def add(self, floor: str, people: Iterable[Iterable[float]]) -> None:
        """Add the current positions of the people on a floor, in mm, in their order."""
        paths = self._paths.setdefault(floor, [])
        for number, (x, y) in enumerate(people):
            if number == len(paths):
                paths.append(DrivenPath(max_points=MAX_POINTS_OF_PEOPLE))
            paths[number].add(x, y)

    @property
    def points(self) -> Mapping[str, Paths]:
        """The paths of the people, by the name of their floor."""
        return {floor: tuple(tuple(p.points) for p in paths) for floor, paths in self._paths.items() if paths}
