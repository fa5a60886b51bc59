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
