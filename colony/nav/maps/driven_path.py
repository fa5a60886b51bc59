"""Paths of robots and people, with a bounded number of points; departures from the map, and stays."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from colony.runtime.observe.summary import OffMap

if TYPE_CHECKING:  # it loads numpy
    from colony.nav.maps.world_map import WorldMap

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


class MapExit:
    """Finds out when a robot leaves the known cells of a grid, and its image. Mutable.

    The attribute `off_map` is None as long as it has not, and in a map that is no grid.
    """

    def __init__(self, floor: WorldMap) -> None:
        self._floor = floor
        self._last_s = 0.0
        self.off_map: OffMap | None = None

    def add(self, t_s: float, x_mm: float, y_mm: float) -> None:
        """Add the robot's position at a time, in mm; times rise."""
        period_s, self._last_s = t_s - self._last_s, t_s
        if self._floor.is_known(x_mm, y_mm):
            return
        off = self.off_map or OffMap(left_known_s=t_s, left_image_s=None, seconds=-period_s)
        has_left = off.left_image_s is None and not self._floor.contains(x_mm, y_mm)
        left_image_s = t_s if has_left else off.left_image_s
        self.off_map = replace(off, left_image_s=left_image_s, seconds=round(off.seconds + period_s, 9))


STAY_MM = 500.0
"""Radius of the circle that a robot leaves when it makes progress."""


class LongestStay:
    """Measures the longest time that a robot spent within `STAY_MM` of one place. Mutable."""

    def __init__(self) -> None:
        self._place = (math.inf, math.inf)
        self._since_s = 0.0
        self.longest_s = 0.0

    def add(self, t_s: float, x_mm: float, y_mm: float) -> None:
        """Add the robot's position at a time, in mm; times rise."""
        if math.dist(self._place, (x_mm, y_mm)) > STAY_MM:
            self._place, self._since_s = (x_mm, y_mm), t_s
        self.longest_s = max(self.longest_s, t_s - self._since_s)
