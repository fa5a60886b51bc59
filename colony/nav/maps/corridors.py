"""The corridors of a floor, and the turning spaces where they meet, derived from its rings of walls.

A ring is cut at its corners into sides: straight walls, which alcoves may interrupt. Two sides that face each
other across at most a corridor's width bound a corridor; collinear pairs, along blocks of rooms in a row, are
one corridor. A jog is too short for sides that face each other: it is bounded by the wall at the end of a
corridor, and by the one that faces this wall from beyond its corner.

The turning space of two corridors is where they overlap (thesis section 5.3); its middle is where their
middle lines cross.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.sides import Side, sides_of
from colony.nav.maps.stickrep.geometry import Point, corners, direction, in_free_space
from colony.nav.maps.stickrep.model import Map
from colony.nav.maps.walls import free_distance, walls_of

NARROWEST_MM, WIDEST_MM = 1000.0, 4500.0
"""Range of a corridor's width, in mm: a wider room is a hall, in which two walls do not guide a robot."""

STAND_MM = 650.0
"""Least distance of a goal from the wall at a corridor's end: the robot's hull has a radius of 0.4 m, and the
Navigator stops half a meter before a wall, or a little sooner at an angle."""

_MIN_FACING_MM = 300.0
_PARALLEL = math.cos(math.radians(3.0))
_COLLINEAR_MM = 350.0
_ALCOVE_MM = 300.0  # largest protrusion of a wall toward the middle
_BESIDE_MM = 150.0
_MOUTH_MM = 6000.0  # largest gap in the walls of a corridor, where another one crosses it


@dataclass(frozen=True, slots=True, kw_only=True)
class Corridor:
    """A straight corridor, as the middle line between its walls.

    Attributes:
        start, end: ends of the middle line, in mm, at the walls in front of which the corridor ends.
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
        """Length of the middle line, in mm."""
        return math.hypot(self.end.x - self.start.x, self.end.y - self.start.y)

    def along(self, x: float, y: float) -> float:
        """Return the distance of a place from `start`, measured along the middle line, in mm."""
        unit = direction(self.heading_deg)
        return (x - self.start.x) * unit.x + (y - self.start.y) * unit.y

    def abreast(self, x: float, y: float) -> float:
        """Return the distance from `start` at which a robot in the middle is abreast of a place, in mm.

        Near the corridor's ends it is limited by `STAND_MM`.
        """
        off = min(STAND_MM, self.length_mm / 2)
        return min(max(self.along(x, y), off), self.length_mm - off)

    def beside(self, x: float, y: float) -> float:
        """Return the distance of a place from the middle line, in mm, positive to its left."""
        unit = direction(self.heading_deg)
        return (y - self.start.y) * unit.x - (x - self.start.x) * unit.y

    def at(self, along_mm: float) -> Point:
        """Return the place on the middle line at this distance from `start`."""
        unit = direction(self.heading_deg)
        return Point(self.start.x + along_mm * unit.x, self.start.y + along_mm * unit.y)


@dataclass(frozen=True, slots=True, kw_only=True)
class TurningSpace:
    """The overlap of two corridors: their indices, and the crossing of their middle lines."""

    corridors: tuple[int, int]
    middle: Point


def corridors_of(source: Map) -> tuple[Corridor, ...]:
    """Return the corridors of a floor, from north to south by their starts; may be empty.

    Rooms, halls and dead ends without length are no corridors.
    """
    floor = _Floor.of(source)
    sides = sides_of(source)
    strips = [strip for strip in _facing(sides) if _is_clear(floor, strip)]
    merged = _merge(floor, _without_accidents(strips))
    merged = _merge(floor, [*merged, *_jogs(floor, sides, merged)])
    found = [_corridor(floor, strip) for strip in merged]
    return tuple(sorted(found, key=lambda c: (-round(c.start.y), round(c.start.x), c.heading_deg)))


def turning_spaces_of(corridors: Sequence[Corridor]) -> tuple[TurningSpace, ...]:
    """Return all pairs of corridors whose middle lines cross, in the order of `corridors`."""
    spaces = []
    for i, one in enumerate(corridors):
        for j in range(i + 1, len(corridors)):
            middle = crossing(one, corridors[j])
            if middle is not None:
                spaces.append(TurningSpace(corridors=(i, j), middle=middle))
    return tuple(spaces)


def crossing(one: Corridor, other: Corridor) -> Point | None:
    """Return the crossing of two middle lines, or None if they are parallel or do not meet.

    A line that ends short of the other by less than half the other's width still reaches it.
    """
    u, v = direction(one.heading_deg), direction(other.heading_deg)
    sine = u.x * v.y - u.y * v.x
    if abs(sine) < 0.1:
        return None
    dx, dy = other.start.x - one.start.x, other.start.y - one.start.y
    first, second = (dx * v.y - dy * v.x) / sine, (dx * u.y - dy * u.x) / sine
    slack, other_slack = other.width_mm / 2, one.width_mm / 2
    if not -slack <= first <= one.length_mm + slack:
        return None
    if not -other_slack <= second <= other.length_mm + other_slack:
        return None
    return one.at(first)


# --- strips: what two facing sides bound ----------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class _Strip:
    """A part of a corridor: along `heading_deg`, in [0, 180), from `low` to `high` of the projection onto it.

    `across` is the middle line's projection onto the direction left of the heading; `seeds` are places on the
    middle line that are probably free, projected like `low`.
    """

    heading_deg: float
    across: float
    low: float
    high: float
    width: float
    seeds: tuple[float, ...]
    edges: frozenset[tuple[int, int]]

    def point(self, along: float) -> Point:
        unit = direction(self.heading_deg)
        return Point(along * unit.x - self.across * unit.y, along * unit.y + self.across * unit.x)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Floor:
    """The walls of a floor, for rays and tests of free space."""

    segments: NDArray[np.float64]
    rings: tuple[tuple[Point, ...], ...]

    @classmethod
    def of(cls, source: Map) -> _Floor:
        return cls(segments=walls_of(source).segments, rings=tuple(corners(ring) for ring in source.rings))

    def is_free(self, at: Point) -> bool:
        return in_free_space(self.rings, at.x, at.y)

    def ray(self, at: Point, heading_deg: float) -> float:
        """Return the distance from a place to the first wall in a direction, in mm; inf if there is none."""
        return free_distance(self.segments, at, direction(heading_deg))


def _facing(sides: Sequence[Side]) -> list[_Strip]:
    """Return the strips between each two sides that face each other."""
    strips = []
    for i, one in enumerate(sides):
        for other in sides[i + 1 :]:
            width = _across(one, other)
            if width is None:
                continue
            low, high = one.low, one.high
            ends = sorted((one.along(other.begin), one.along(other.end)))
            low, high = max(low, ends[0]), min(high, ends[1])
            if high - low >= _MIN_FACING_MM:
                strips.append(_strip(one, width, low, high, one.edges + other.edges))
    return strips


def _across(one: Side, other: Side) -> float | None:
    """Return the distance between two sides that face each other, or None if it is no corridor's width."""
    u, v = direction(one.heading_deg), direction(other.heading_deg)
    if u.x * v.x + u.y * v.y > -_PARALLEL:
        return None
    width = one.right_of(other.begin) / 2 + one.right_of(other.end) / 2
    return width if NARROWEST_MM <= width <= WIDEST_MM else None


def _strip(side: Side, width: float, low: float, high: float, edges: tuple[tuple[int, int], ...]) -> _Strip:
    """Return the strip of `width` to the right of a side, from `low` to `high` along it."""
    heading = side.heading_deg % 180.0
    if 180.0 - heading < 1e-6:
        heading = 0.0
    unit, way = direction(heading), direction(side.heading_deg)
    right = Point(way.y, -way.x)
    ends = [
        Point(
            side.begin.x + at * way.x + right.x * (width / 2 + side.inset),
            side.begin.y + at * way.y + right.y * (width / 2 + side.inset),
        )
        for at in (low, high)
    ]
    across = sum(p.y * unit.x - p.x * unit.y for p in ends) / 2
    first, last = sorted(p.x * unit.x + p.y * unit.y for p in ends)
    seeds = tuple(first + part * (last - first) for part in (0.25, 0.5, 0.75))
    return _Strip(
        heading_deg=heading, across=across, low=first, high=last, width=width,
        seeds=seeds, edges=frozenset(edges),
    )  # fmt: skip


def _is_clear(floor: _Floor, strip: _Strip) -> bool:
    """Return True if nothing stands between the two sides at one or more of the seeds."""
    least = strip.width / 2 - _ALCOVE_MM
    for seed in strip.seeds:
        at = strip.point(seed)
        if floor.is_free(at) and all(
            floor.ray(at, strip.heading_deg + turn) >= least for turn in (90.0, -90.0)
        ):
            return True
    return False


def _without_accidents(strips: Sequence[_Strip]) -> list[_Strip]:
    """Leave out strips that are wider than long, and whose sides bound longer strips with others.

    The outer walls of a short jog face each other across its two turning spaces.
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
            if _continues(floor, other, strip):
                merged[i] = _joined(other, strip)
                break
        else:
            merged.append(strip)
    return merged if len(merged) == len(strips) else _merge(floor, merged)


def _continues(floor: _Floor, one: _Strip, other: _Strip) -> bool:
    turn = abs(one.heading_deg - other.heading_deg) % 180.0
    if min(turn, 180.0 - turn) > 3.0 or abs(one.across - other.across) > _COLLINEAR_MM:
        return False
    gap = max(one.low, other.low) - min(one.high, other.high)
    if gap <= 0.0:
        return True
    first = min((one, other), key=lambda s: s.low)
    return gap <= _MOUTH_MM and floor.ray(first.point(first.high), first.heading_deg) >= gap


def _joined(one: _Strip, other: _Strip) -> _Strip:
    """Join two strips; their middle lines are averaged by their lengths."""
    long, more = one.high - one.low, other.high - other.low
    return replace(
        one,
        across=(one.across * long + other.across * more) / (long + more),
        width=one.width if long >= more else other.width,
        low=min(one.low, other.low),
        high=max(one.high, other.high),
        seeds=(*one.seeds, *other.seeds),
        edges=one.edges | other.edges,
    )


def _jogs(floor: _Floor, sides: Sequence[Side], strips: Sequence[_Strip]) -> list[_Strip]:
    """Return the strips before sides that face no other and end a corridor.

    The wall that faces such a side is searched from beyond the side's outer corner, across the other
    corridor.
    """
    bounding = {edge: strip for strip in strips for edge in strip.edges}
    found = []
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
        strip = _jog(floor, side, side.turn_after > 0.0, corridor.width - _BESIDE_MM)
        if strip is not None:
            found.append(strip)
    return found


def _jog(floor: _Floor, side: Side, at_its_end: bool, beyond: float) -> _Strip | None:
    along = side.high + beyond if at_its_end else side.low - beyond
    way = direction(side.heading_deg)
    from_here = Point(side.begin.x + along * way.x, side.begin.y + along * way.y)
    width = floor.ray(from_here, side.heading_deg - 90.0)
    if not floor.is_free(from_here) or not NARROWEST_MM <= width <= WIDEST_MM:
        return None
    low, high = sorted((along, side.high if not at_its_end else side.low))
    return _strip(side, width, low, high, side.edges)


def _corridor(floor: _Floor, strip: _Strip) -> Corridor:
    """Extend a strip to the walls at its ends, but by at most a corridor's width."""
    low, high = strip.low, strip.high
    for seed in strip.seeds:
        at = strip.point(seed)
        if floor.is_free(at):
            high = max(high, seed + floor.ray(at, strip.heading_deg))
            low = min(low, seed - floor.ray(at, strip.heading_deg + 180.0))
    low, high = max(low, strip.low - WIDEST_MM), min(high, strip.high + WIDEST_MM)
    return Corridor(
        start=strip.point(low),
        end=strip.point(high),
        heading_deg=strip.heading_deg,
        width_mm=strip.width,
        edges=tuple(sorted(strip.edges)),
    )
