"""A planned path: straight segments in the modes of the Navigator (thesis section 5.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from colony.nav.maps.corridors import Corridor, crossing
from colony.nav.maps.stickrep.geometry import Point, direction
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


# --- legs ---------------------------------------------------------------------------------------------
#
# Divides a path through corridors into straight legs, and each leg into segments (section 5.3).
#
# L  from the start of the leg to below its last light; omitted on a leg without lights
# E  on to the center of the turning space (all legs but the last)
# C  from there, in the heading of the next leg, out of the turning space
# D  on to the goal (last leg only)

LEAVE_MM = 500.0
"""Distance that a robot drives out of a turning space before it looks for lights."""

LIGHT_AHEAD_MM = 600.0
"""Minimum distance to a light where tracking begins: the leading edge of a nearer light, 0.3 m before its
center, is about to pass or has passed already."""

LIGHT_BEFORE_GOAL_MM = 500.0
"""Minimum distance from a tracked light to the goal: a robot that passes the light may overshoot."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """A straight part of a path along the middle of one corridor.

    `before_mm` and `after_mm` are the lengths within the turning spaces at its start and end.
    """

    corridor: Corridor
    start: Point
    end: Point
    before_mm: float = 0.0
    after_mm: float = 0.0

    @property
    def length_mm(self) -> float:
        """Length of the leg, in mm."""
        return math.hypot(self.end.x - self.start.x, self.end.y - self.start.y)

    @property
    def heading_deg(self) -> float:
        """Heading of the leg; a leg without length has its corridor's heading."""
        along = self.corridor.along(*self.end) - self.corridor.along(*self.start)
        return self.corridor.heading_deg if along >= 0.0 else (self.corridor.heading_deg + 180.0) % 360.0

    def point_at(self, along_mm: float) -> Point:
        """Return the point at this distance from the start."""
        unit = direction(self.heading_deg)
        return Point(self.start.x + along_mm * unit.x, self.start.y + along_mm * unit.y)


@dataclass(frozen=True, slots=True)
class DisconnectedCorridors:
    """Two successive corridors of a path that do not meet."""

    first: Corridor
    second: Corridor


def legs_of(
    corridors: tuple[Corridor, ...], origin: Point, goal: Point
) -> tuple[Leg, ...] | DisconnectedCorridors:
    """Return the legs through corridors, from abreast of `origin` to abreast of `goal`."""
    order = _without_returns(list(range(len(corridors))), corridors)
    bends = []
    for i, j in pairwise(order):
        corner = crossing(corridors[i], corridors[j])
        if corner is None:
            return DisconnectedCorridors(corridors[i], corridors[j])
        bends.append(corner)
    chain = [corridors[i] for i in order]
    first, last = chain[0], chain[-1]
    ends = [
        first.point_at(first.reachable_along(*origin)),
        *bends,
        last.point_at(last.reachable_along(*goal)),
    ]
    legs = []
    for i, corridor in enumerate(chain):
        before = chain[i - 1].width_mm / 2 if i > 0 else 0.0
        after = chain[i + 1].width_mm / 2 if i + 1 < len(chain) else 0.0
        legs.append(Leg(corridor=corridor, start=ends[i], end=ends[i + 1], before_mm=before, after_mm=after))
    return tuple(legs)


def _without_returns(order: list[int], corridors: tuple[Corridor, ...]) -> list[int]:
    """Leave out dead ends, which the path enters from a corridor only to return to it."""
    kept: list[int] = []
    for i in order:
        if kept and corridors[kept[-1]] == corridors[i]:
            continue
        if len(kept) > 1 and corridors[kept[-2]] == corridors[i]:
            kept.pop()
            continue
        kept.append(i)
    return kept


def segments_of(
    legs: tuple[Leg, ...], lights: tuple[Point, ...], floor: str
) -> tuple[tuple[Segment, ...], str]:
    """Return the segments of legs on one floor, and the string of their modes."""
    segments: list[Segment] = []
    modes = ""
    for i, leg in enumerate(legs):
        last = i == len(legs) - 1
        light_distances = _lights_on(leg, lights, first=i == 0, last=last)
        start_mm = 0.0
        if i > 0:
            start_mm = _exit_mm(leg, light_distances)
            segments.append(_segment(GoalKind.CORNER, leg, 0.0, start_mm, floor))
            modes += "c"
        if light_distances:
            offsets = tuple(distance - start_mm for distance in light_distances)
            segments.append(_segment(GoalKind.LIGHTS, leg, start_mm, light_distances[-1], floor, offsets))
            modes += "l"
            start_mm = light_distances[-1]
        kind = GoalKind.DEAD_RECKONING if last else GoalKind.ENTER_CORNER
        segments.append(_segment(kind, leg, start_mm, leg.length_mm, floor))
    return tuple(segments), modes + "d"


def _lights_on(leg: Leg, lights: tuple[Point, ...], first: bool, last: bool) -> tuple[float, ...]:
    """Return the distances of the lights to track on a leg, from its start, ascending."""
    unit = direction(leg.heading_deg)
    low = LIGHT_AHEAD_MM if first else leg.before_mm + LIGHT_AHEAD_MM
    high = leg.length_mm - (LIGHT_BEFORE_GOAL_MM if last else leg.after_mm)
    distances = []
    for light in lights:
        dx, dy = light.x - leg.start.x, light.y - leg.start.y
        along, left = dx * unit.x + dy * unit.y, dy * unit.x - dx * unit.y
        if low <= along <= high and abs(left) <= leg.corridor.width_mm / 2:
            distances.append(along)
    return tuple(sorted(distances))


def _exit_mm(leg: Leg, light_distances: tuple[float, ...]) -> float:
    """Return the distance to drive out of the turning space in which a leg begins.

    It is at most half of the leg's length, so that a robot that overshoots is still before the leg's end. It
    also ends before the first light.
    """
    exit_mm = min(leg.before_mm + LEAVE_MM, leg.length_mm / 2)
    return min(exit_mm, light_distances[0] - LIGHT_AHEAD_MM) if light_distances else exit_mm


def _segment(
    kind: GoalKind, leg: Leg, start: float, end: float, floor: str, lights: tuple[float, ...] = ()
) -> Segment:
    return Segment(
        kind=kind,
        heading_deg=leg.heading_deg,
        start=FloorPoint(*leg.point_at(start), floor),
        end=FloorPoint(*leg.point_at(end), floor),
        width_mm=leg.corridor.width_mm,
        lights_mm=lights,
    )
