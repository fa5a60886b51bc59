"""A planned path: straight segments in the modes of the Navigator (thesis section 5.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from colony.nav.shared import GoalKind


class FloorPoint(NamedTuple):
    """A point of a floor, in mm, x east and y north; `floor` is the name of its map."""

    x_mm: float
    y_mm: float
    floor: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """A straight part of a path in one mode, along the middle of a corridor, from `start` to `end`.

    In the light-tracking mode `lights_mm` are the distances of the lights from `start`, ascending, and `end`
    is below the last one. A corner segment begins at the center of the turning space, with a turn to its
    heading, and ends in the next corridor. `width_mm` is the corridor's.

    An elevator segment starts in front of the elevator's doors, which the robot faces at `heading_deg`, and
    ends in front of its doors on another floor, whose map shows them rotated by `turn_deg` counterclockwise.
    Its `width_mm` is that of the doors, `doors_mm` are the distances of the doors from its start and from its
    end, and `doors` are the nodes where they begin on either floor.
    """

    kind: GoalKind
    heading_deg: float
    start: FloorPoint
    end: FloorPoint
    width_mm: float
    lights_mm: tuple[float, ...] = ()
    turn_deg: float = 0.0
    doors_mm: tuple[float, float] = (0.0, 0.0)
    doors: tuple[str, str] = ("", "")

    @property
    def length_mm(self) -> float:
        """Length from start to end; 0 for a ride, as each floor has coordinates of its own."""
        if self.start.floor != self.end.floor:
            return 0.0
        return math.hypot(self.end.x_mm - self.start.x_mm, self.end.y_mm - self.start.y_mm)


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A path from one node of a map to another.

    Attributes:
        origin, goal: names of nodes, "350R".
        segments: the segments in order; the first begins at the robot's position.
        distance_mm: for travel with the wall on the left, the sum of the counted edges along the rings, as in
            the thesis's tables; else the distance along the middle of the corridors.
        modes: one letter per mode, for the confidence automaton: "lclcld". A corner is one `c`, even if it
            has two segments (section 6.3); an elevator ride is a `v`, which the thesis does not have.
    """

    origin: str
    goal: str
    segments: tuple[Segment, ...]
    distance_mm: float
    modes: str

    @property
    def start(self) -> tuple[float, float, float]:
        """The pose where the path begins: x and y in mm, and the heading in degrees."""
        first = self.segments[0]
        return first.start.x_mm, first.start.y_mm, first.heading_deg

    @property
    def floors(self) -> tuple[str, ...]:
        """The names of the maps on the path, without repetitions, in order."""
        points = (point for segment in self.segments for point in (segment.start, segment.end))
        return tuple(dict.fromkeys(point.floor for point in points))

    @property
    def travel_mm(self) -> float:
        """Distance that the robot travels, along the middle of the corridors, in mm."""
        return sum(segment.length_mm for segment in self.segments)
