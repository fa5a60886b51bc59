"""The corridors of a floor, and the turning spaces where they meet, derived from its rings of walls.

A ring is cut at its corners into sides: straight walls, which alcoves may interrupt. Two sides that face each
other across at most a corridor's width bound a corridor; collinear pairs, along blocks of rooms in a row, are
one corridor. A jog is too short for sides that face each other: it is bounded by the wall at the end of a
corridor, and by the one that faces this wall from beyond its corner.

The turning space of two corridors is where they overlap (thesis section 5.3); its center is where their
centerlines cross.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.stickrep.geometry import Point, corners, direction, in_free_space, trace
from colony.nav.maps.stickrep.model import Map, Ring
from colony.nav.maps.walls import free_distance, walls_of

# --- sides --------------------------------------------------------------------------------------------
#
# The sides of a ring: its walls from corner to corner, each as one straight line, without alcoves.

_SAME_HEADING_DEG = 2.0
_SAME_LINE_MM = 60.0
_MIN_TURN_DEG = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """The part of a ring from one corner to the next, traced with the wall on the left.

    Attributes:
        ring: index of the ring.
        begin, end: the corners, in mm.
        heading_deg: heading of the largest part of the side.
        inset: offset to the right of `begin` of the line on which most of the side lies, in mm.
        edges: indices (ring, edge) of its edges, in order.
        turn_before, turn_after: turns of the ring at either end, counterclockwise, in degrees.
    """

    ring: int
    begin: Point
    end: Point
    heading_deg: float
    inset: float
    edges: tuple[tuple[int, int], ...]
    turn_before: float
    turn_after: float

    def along(self, point: Point) -> float:
        """Return the distance of a point from `begin`, along the heading, in mm."""
        unit = direction(self.heading_deg)
        return (point.x - self.begin.x) * unit.x + (point.y - self.begin.y) * unit.y

    def right_of(self, point: Point) -> float:
        """Return the distance of a point to the right of the line on which most of the side lies, in mm."""
        unit = direction(self.heading_deg)
        return (point.x - self.begin.x) * unit.y - (point.y - self.begin.y) * unit.x - self.inset

    @property
    def low(self) -> float:
        """Start of the side, as measured by `along`."""
        return min(0.0, self.along(self.end))

    @property
    def high(self) -> float:
        """End of the side, as measured by `along`."""
        return max(0.0, self.along(self.end))


def sides_of(source: Map) -> tuple[Side, ...]:
    """Return the sides of all rings, in their order."""
    return tuple(side for i, ring in enumerate(source.rings) for side in _ring_sides(i, ring))


def _ring_sides(index: int, ring: Ring) -> list[Side]:
    cuts = _corner_indices(ring)
    count = len(ring.edges)
    sides = []
    for cut, next_cut in zip(cuts, [*cuts[1:], cuts[0] + count], strict=True):
        sides.append(_side(index, ring, [k % count for k in range(cut, next_cut)]))
    return sides


def _corner_indices(ring: Ring) -> list[int]:
    """Return the indices of a ring's corners: the nodes at which its walls change direction for good."""
    marked_corners = [i for i, node in enumerate(ring.nodes) if node.corner]
    if len(marked_corners) >= 3:
        return marked_corners
    sharp_turns = [i for i, node in enumerate(ring.nodes) if abs(node.turn_deg) >= _MIN_TURN_DEG]
    return sharp_turns or [0]


def _side(index: int, ring: Ring, edges: list[int]) -> Side:
    nodes, headings = corners(ring), trace(ring).headings_deg
    begin, end = nodes[edges[0]], nodes[(edges[-1] + 1) % len(nodes)]
    heading = _weighted_mode(
        [(headings[k], ring.edges[k].length_mm) for k in edges], _SAME_HEADING_DEG, period=360.0
    )
    unit = direction(heading)
    lines = []
    for k in edges:
        if _angle_between(headings[k], heading) <= _SAME_HEADING_DEG:
            here = nodes[k]
            right = (here.x - begin.x) * unit.y - (here.y - begin.y) * unit.x
            lines.append((right, ring.edges[k].length_mm))
    return Side(
        ring=index,
        begin=begin,
        end=end,
        heading_deg=heading,
        inset=_weighted_mode(lines, _SAME_LINE_MM),
        edges=tuple((index, k) for k in edges),
        turn_before=ring.nodes[edges[0]].turn_deg,
        turn_after=ring.nodes[(edges[-1] + 1) % len(nodes)].turn_deg,
    )


def _angle_between(a: float, b: float) -> float:
    return abs((a - b + 180.0) % 360.0 - 180.0)


def _weighted_mode(values: list[tuple[float, float]], tolerance: float, period: float = math.inf) -> float:
    """Return the value with the largest total weight of values within `tolerance`."""

    def distance(a: float, b: float) -> float:
        return abs(a - b) if period == math.inf else _angle_between(a, b)

    weights = [sum(w for other, w in values if distance(value, other) <= tolerance) for value, _ in values]
    return values[weights.index(max(weights))][0]


# --- corridors ----------------------------------------------------------------------------------------

MIN_WIDTH_MM, MAX_WIDTH_MM = 1000.0, 4500.0
"""Range of a corridor's width, in mm. A wider room is a hall, whose walls do not guide a robot."""

END_CLEARANCE_MM = 650.0
"""Minimum distance of a goal from the wall at a corridor's end: the robot's hull has a radius of 0.4 m, and
the Navigator stops half a meter before a wall, or a little sooner at an angle."""

_MIN_FACING_MM = 300.0
_PARALLEL = math.cos(math.radians(3.0))
_COLLINEAR_MM = 350.0
_ALCOVE_MM = 300.0  # maximum protrusion of a wall toward the center
_PROBE_MARGIN_MM = 150.0
_MOUTH_MM = 6000.0  # maximum gap in the walls of a corridor, where another one crosses it


@dataclass(frozen=True, slots=True, kw_only=True)
class Corridor:
    """A straight corridor, given by the centerline between its walls.

    Attributes:
        start, end: ends of the centerline, in mm, at the walls in front of which the corridor ends.
        heading_deg: heading from start to end; corridors along an axis lead west or north.
        width_mm: distance between its walls, apart from alcoves.
        edges: indices (ring, edge) of the edges that bound it, alcoves included, ascending.
    """

    start: Point
    end: Point
    heading_deg: float
    width_mm: float
    edges: tuple[tuple[int, int], ...]

    @property
    def length_mm(self) -> float:
        """Length of the centerline, in mm."""
        return math.hypot(self.end.x - self.start.x, self.end.y - self.start.y)

    def along(self, x: float, y: float) -> float:
        """Return the distance from `start` to the foot of a point on the centerline, in mm."""
        unit = direction(self.heading_deg)
        return (x - self.start.x) * unit.x + (y - self.start.y) * unit.y

    def reachable_along(self, x: float, y: float) -> float:
        """Return the position along the centerline at which a robot is abreast of a point, in mm.

        It keeps `END_CLEARANCE_MM` from the corridor's ends.
        """
        clearance = min(END_CLEARANCE_MM, self.length_mm / 2)
        return min(max(self.along(x, y), clearance), self.length_mm - clearance)

    def offset(self, x: float, y: float) -> float:
        """Return the distance of a point from the centerline, in mm, positive to the left."""
        unit = direction(self.heading_deg)
        return (y - self.start.y) * unit.x - (x - self.start.x) * unit.y

    def point_at(self, along_mm: float) -> Point:
        """Return the point on the centerline at this distance from `start`."""
        unit = direction(self.heading_deg)
        return Point(self.start.x + along_mm * unit.x, self.start.y + along_mm * unit.y)


@dataclass(frozen=True, slots=True, kw_only=True)
class TurningSpace:
    """The overlap of two corridors: their indices, and the crossing of their centerlines."""

    corridors: tuple[int, int]
    center: Point


def corridors_of(source: Map) -> tuple[Corridor, ...]:
    """Return the corridors of a floor, from north to south by their starts; may be empty.

    Rooms, halls and dead ends without length are not corridors.
    """
    floor = _Floor.of(source)
    sides = sides_of(source)
    strips = [strip for strip in _facing_strips(sides) if _is_clear(floor, strip)]
    merged = _merge(floor, _without_spurious(strips))
    merged = _merge(floor, [*merged, *_jogs(floor, sides, merged)])
    corridors = [_corridor(floor, strip) for strip in merged]
    return tuple(sorted(corridors, key=lambda c: (-round(c.start.y), round(c.start.x), c.heading_deg)))


def turning_spaces_of(corridors: Sequence[Corridor]) -> tuple[TurningSpace, ...]:
    """Return all pairs of corridors whose centerlines cross, in the order of `corridors`."""
    spaces = []
    for i, corridor in enumerate(corridors):
        for j in range(i + 1, len(corridors)):
            center = crossing(corridor, corridors[j])
            if center is not None:
                spaces.append(TurningSpace(corridors=(i, j), center=center))
    return tuple(spaces)


def crossing(corridor: Corridor, other: Corridor) -> Point | None:
    """Return the crossing of two centerlines, or None if they are parallel or too far apart.

    A centerline may end short of the other by up to half the other corridor's width.
    """
    u, v = direction(corridor.heading_deg), direction(other.heading_deg)
    sine = u.x * v.y - u.y * v.x
    if abs(sine) < 0.1:
        return None
    dx, dy = other.start.x - corridor.start.x, other.start.y - corridor.start.y
    along, other_along = (dx * v.y - dy * v.x) / sine, (dx * u.y - dy * u.x) / sine
    slack, other_slack = other.width_mm / 2, corridor.width_mm / 2
    if not -slack <= along <= corridor.length_mm + slack:
        return None
    if not -other_slack <= other_along <= other.length_mm + other_slack:
        return None
    return corridor.point_at(along)


# --- strips: the areas between two facing sides ----------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class _Strip:
    """A part of a corridor: from `low` to `high` in the projection onto `heading_deg`, which is in [0, 180).

    `offset` is the centerline's projection onto the direction left of the heading; `seeds` are points on the
    centerline that are probably free, projected like `low`.
    """

    heading_deg: float
    offset: float
    low: float
    high: float
    width: float
    seeds: tuple[float, ...]
    edges: frozenset[tuple[int, int]]

    def point(self, along: float) -> Point:
        unit = direction(self.heading_deg)
        return Point(along * unit.x - self.offset * unit.y, along * unit.y + self.offset * unit.x)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Floor:
    """The walls of a floor, for ray casting and tests of free space."""

    segments: NDArray[np.float64]
    rings: tuple[tuple[Point, ...], ...]

    @classmethod
    def of(cls, source: Map) -> _Floor:
        return cls(segments=walls_of(source).segments, rings=tuple(corners(ring) for ring in source.rings))

    def is_free(self, point: Point) -> bool:
        return in_free_space(self.rings, point.x, point.y)

    def ray(self, origin: Point, heading_deg: float) -> float:
        """Return the distance to the first wall in a direction, in mm; inf if there is none."""
        return free_distance(self.segments, origin, direction(heading_deg))


def _facing_strips(sides: Sequence[Side]) -> list[_Strip]:
    """Return the strips between all pairs of sides that face each other."""
    strips = []
    for i, side in enumerate(sides):
        for other in sides[i + 1 :]:
            width = _facing_width(side, other)
            if width is None:
                continue
            low, high = side.low, side.high
            ends = sorted((side.along(other.begin), side.along(other.end)))
            low, high = max(low, ends[0]), min(high, ends[1])
            if high - low >= _MIN_FACING_MM:
                strips.append(_strip(side, width, low, high, side.edges + other.edges))
    return strips


def _facing_width(side: Side, other: Side) -> float | None:
    """Return the distance between two sides that face each other, or None if no corridor is that wide."""
    u, v = direction(side.heading_deg), direction(other.heading_deg)
    if u.x * v.x + u.y * v.y > -_PARALLEL:
        return None
    width = side.right_of(other.begin) / 2 + side.right_of(other.end) / 2
    return width if MIN_WIDTH_MM <= width <= MAX_WIDTH_MM else None


def _strip(side: Side, width: float, low: float, high: float, edges: tuple[tuple[int, int], ...]) -> _Strip:
    """Return the strip of `width` to the right of a side, from `low` to `high` along it."""
    heading = side.heading_deg % 180.0
    if 180.0 - heading < 1e-6:
        heading = 0.0
    unit, forward = direction(heading), direction(side.heading_deg)
    right = Point(forward.y, -forward.x)
    ends = [
        Point(
            side.begin.x + along * forward.x + right.x * (width / 2 + side.inset),
            side.begin.y + along * forward.y + right.y * (width / 2 + side.inset),
        )
        for along in (low, high)
    ]
    offset = sum(p.y * unit.x - p.x * unit.y for p in ends) / 2
    begin, end = sorted(p.x * unit.x + p.y * unit.y for p in ends)
    seeds = tuple(begin + fraction * (end - begin) for fraction in (0.25, 0.5, 0.75))
    return _Strip(
        heading_deg=heading, offset=offset, low=begin, high=end, width=width,
        seeds=seeds, edges=frozenset(edges),
    )  # fmt: skip


def _is_clear(floor: _Floor, strip: _Strip) -> bool:
    """Return True if at least at one seed nothing stands between the two sides."""
    min_distance = strip.width / 2 - _ALCOVE_MM
    for seed in strip.seeds:
        point = strip.point(seed)
        if floor.is_free(point) and all(
            floor.ray(point, strip.heading_deg + turn) >= min_distance for turn in (90.0, -90.0)
        ):
            return True
    return False


def _without_spurious(strips: Sequence[_Strip]) -> list[_Strip]:
    """Leave out strips that are wider than long, if both sides also bound longer strips.

    Such strips arise at a short jog, whose outer walls face each other across its two turning spaces.
    """
    kept: list[_Strip] = []
    bounding: set[tuple[int, int]] = set()
    for strip in sorted(strips, key=lambda s: s.low - s.high):
        if strip.high - strip.low >= strip.width or not strip.edges <= bounding:
            kept.append(strip)
            bounding |= strip.edges
    return kept


def _merge(floor: _Floor, strips: Sequence[_Strip]) -> list[_Strip]:
    """Join collinear strips with at most the mouth of a corridor between them."""
    merged: list[_Strip] = []
    for strip in sorted(strips, key=lambda s: (s.heading_deg, s.low)):
        for i, other in enumerate(merged):
            if _is_continuation(floor, other, strip):
                merged[i] = _join(other, strip)
                break
        else:
            merged.append(strip)
    return merged if len(merged) == len(strips) else _merge(floor, merged)


def _is_continuation(floor: _Floor, strip: _Strip, other: _Strip) -> bool:
    turn = abs(strip.heading_deg - other.heading_deg) % 180.0
    if min(turn, 180.0 - turn) > 3.0 or abs(strip.offset - other.offset) > _COLLINEAR_MM:
        return False
    gap = max(strip.low, other.low) - min(strip.high, other.high)
    if gap <= 0.0:
        return True
    lower = min((strip, other), key=lambda s: s.low)
    return gap <= _MOUTH_MM and floor.ray(lower.point(lower.high), lower.heading_deg) >= gap


def _join(strip: _Strip, other: _Strip) -> _Strip:
    """Join two strips; their centerlines are averaged, weighted by length."""
    length, other_length = strip.high - strip.low, other.high - other.low
    return replace(
        strip,
        offset=(strip.offset * length + other.offset * other_length) / (length + other_length),
        width=strip.width if length >= other_length else other.width,
        low=min(strip.low, other.low),
        high=max(strip.high, other.high),
        seeds=(*strip.seeds, *other.seeds),
        edges=strip.edges | other.edges,
    )


def _jogs(floor: _Floor, sides: Sequence[Side], strips: Sequence[_Strip]) -> list[_Strip]:
    """Return the strips in front of sides that end a corridor and face no other side.

    The wall that faces such a side is found from a probe point beyond the side's outer corner, across the
    other corridor.
    """
    bounding = {edge: strip for strip in strips for edge in strip.edges}
    jogs = []
    for side in sides:
        if side.edges[0] in bounding or side.turn_before * side.turn_after >= 0.0:
            continue
        ring = [s for s in sides if s.ring == side.ring]
        here = ring.index(side)
        before, after = ring[here - 1], ring[(here + 1) % len(ring)]
        beyond = after if side.turn_after > 0.0 else before
        corridor = bounding.get(beyond.edges[0])
        if corridor is None or before.edges[0] not in bounding or after.edges[0] not in bounding:
            continue
        strip = _jog(floor, side, side.turn_after > 0.0, corridor.width - _PROBE_MARGIN_MM)
        if strip is not None:
            jogs.append(strip)
    return jogs


def _jog(floor: _Floor, side: Side, at_end: bool, probe_mm: float) -> _Strip | None:
    along = side.high + probe_mm if at_end else side.low - probe_mm
    forward = direction(side.heading_deg)
    probe = Point(side.begin.x + along * forward.x, side.begin.y + along * forward.y)
    width = floor.ray(probe, side.heading_deg - 90.0)
    if not floor.is_free(probe) or not MIN_WIDTH_MM <= width <= MAX_WIDTH_MM:
        return None
    low, high = sorted((along, side.high if not at_end else side.low))
    return _strip(side, width, low, high, side.edges)


def _corridor(floor: _Floor, strip: _Strip) -> Corridor:
    """Extend a strip to the walls at its ends, but by at most a corridor's width."""
    low, high = strip.low, strip.high
    for seed in strip.seeds:
        point = strip.point(seed)
        if floor.is_free(point):
            high = max(high, seed + floor.ray(point, strip.heading_deg))
            low = min(low, seed - floor.ray(point, strip.heading_deg + 180.0))
    low, high = max(low, strip.low - MAX_WIDTH_MM), min(high, strip.high + MAX_WIDTH_MM)
    return Corridor(
        start=strip.point(low),
        end=strip.point(high),
        heading_deg=strip.heading_deg,
        width_mm=strip.width,
        edges=tuple(sorted(strip.edges)),
    )
