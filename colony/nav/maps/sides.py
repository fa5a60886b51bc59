"""The sides of a ring: its walls from corner to corner, each as one straight line, without alcoves."""

from __future__ import annotations

import math
from dataclasses import dataclass

from colony.nav.maps.stickrep.geometry import Point, corners, direction, trace
from colony.nav.maps.stickrep.model import Map, Ring

_SAME_HEADING_DEG = 2.0
_SAME_LINE_MM = 60.0
_MIN_TURN_DEG = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """The part of a ring from one corner to the next, traced with the wall on the left.

    Attributes:
        ring: its index.
        begin, end: the corners, in mm.
        heading_deg: heading of most of its length.
        inset: distance of the line on which most of it lies to the right of `begin`, in mm.
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

    def along(self, at: Point) -> float:
        """Return the distance of a place from `begin`, along the heading, in mm."""
        unit = direction(self.heading_deg)
        return (at.x - self.begin.x) * unit.x + (at.y - self.begin.y) * unit.y

    def right_of(self, at: Point) -> float:
        """Return the distance of a place to the right of the line on which most of the side lies, in mm."""
        unit = direction(self.heading_deg)
        return (at.x - self.begin.x) * unit.y - (at.y - self.begin.y) * unit.x - self.inset

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
    cuts = _cuts(ring)
    count = len(ring.edges)
    sides = []
    for at, following in zip(cuts, [*cuts[1:], cuts[0] + count], strict=True):
        sides.append(_side(index, ring, [k % count for k in range(at, following)]))
    return sides


def _cuts(ring: Ring) -> list[int]:
    """Return the nodes at which a ring's walls change direction for good: its corners."""
    named = [i for i, node in enumerate(ring.nodes) if node.corner]
    if len(named) >= 3:
        return named
    turning = [i for i, node in enumerate(ring.nodes) if abs(node.turn_deg) >= _MIN_TURN_DEG]
    return turning or [0]


def _side(index: int, ring: Ring, edges: list[int]) -> Side:
    nodes, headings = corners(ring), trace(ring).headings_deg
    begin, end = nodes[edges[0]], nodes[(edges[-1] + 1) % len(nodes)]
    heading = _most([(headings[k], ring.edges[k].length_mm) for k in edges], _SAME_HEADING_DEG, period=360.0)
    unit = direction(heading)
    lines = []
    for k in edges:
        if _apart(headings[k], heading) <= _SAME_HEADING_DEG:
            here = nodes[k]
            right = (here.x - begin.x) * unit.y - (here.y - begin.y) * unit.x
            lines.append((right, ring.edges[k].length_mm))
    return Side(
        ring=index,
        begin=begin,
        end=end,
        heading_deg=heading,
        inset=_most(lines, _SAME_LINE_MM),
        edges=tuple((index, k) for k in edges),
        turn_before=ring.nodes[edges[0]].turn_deg,
        turn_after=ring.nodes[(edges[-1] + 1) % len(nodes)].turn_deg,
    )


def _apart(one: float, other: float) -> float:
    return abs((one - other + 180.0) % 360.0 - 180.0)


def _most(values: list[tuple[float, float]], near: float, period: float = math.inf) -> float:
    """Return the value that has the most weight near it."""

    def distance(one: float, other: float) -> float:
        return abs(one - other) if period == math.inf else _apart(one, other)

    weights = [sum(w for other, w in values if distance(value, other) <= near) for value, _ in values]
    return values[weights.index(max(weights))][0]
