"""The positions of a ring's nodes and shared lights: plane geometry on StickRep, without arrays.

A ring is stored as turns and lengths, and lengths are counted in bricks: traced once around, it rarely ends
exactly where it began. The gap is distributed by the compass rule, as surveyors do in a closed traverse: each
edge takes a share in proportion to its length. The walls then have no gaps, and no node moves by more than
the original gap.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from colony.nav.maps.stickrep.model import Map, Ring, RingPosition

_EXACT = {0.0: (0.0, 1.0), 90.0: (-1.0, 0.0), 180.0: (0.0, -1.0), 270.0: (1.0, 0.0)}


class Point(NamedTuple):
    """A point in mm: x east, y north."""

    x: float
    y: float


def direction(heading_deg: float) -> Point:
    """Return the unit vector of a heading, exact along the four axes."""
    exact = _EXACT.get(heading_deg % 360.0)
    if exact is not None:
        return Point(*exact)
    angle = math.radians(heading_deg)
    return Point(-math.sin(angle), math.cos(angle))


@dataclass(frozen=True, slots=True, kw_only=True)
class RingTrace:
    """A ring walked once around, before its gap is closed.

    Attributes:
        points: positions of the nodes, and the end of the last edge.
        headings_deg: headings of the edges, in [0, 360).
        total_turn_deg: the sum of all turns; -360 for an outline, 360 for a block, if the ring closes.
    """

    points: tuple[Point, ...]
    headings_deg: tuple[float, ...]
    total_turn_deg: float

    @property
    def gap(self) -> Point:
        """Vector from the first node to the end of the last edge, in mm."""
        return Point(self.points[-1].x - self.points[0].x, self.points[-1].y - self.points[0].y)


def trace(ring: Ring) -> RingTrace:
    """Walk along a ring from its start. The first node's turn only counts toward the total."""
    heading = ring.start.heading_deg
    points = [Point(ring.start.x_mm, ring.start.y_mm)]
    headings = []
    for i, (node, edge) in enumerate(zip(ring.nodes, ring.edges, strict=True)):
        if i > 0:
            heading += node.turn_deg
        step = direction(heading)
        last = points[-1]
        points.append(Point(last.x + edge.length_mm * step.x, last.y + edge.length_mm * step.y))
        headings.append(heading % 360.0)
    return RingTrace(
        points=tuple(points),
        headings_deg=tuple(headings),
        total_turn_deg=sum(node.turn_deg for node in ring.nodes),
    )


def corners(ring: Ring) -> tuple[Point, ...]:
    """Return the positions of a ring's nodes, in mm, with its gap distributed by the compass rule."""
    walked = trace(ring)
    gap = walked.gap
    total = math.fsum(edge.length_mm for edge in ring.edges)
    closed, walked_mm = [], 0.0
    for point, edge in zip(walked.points, ring.edges, strict=False):
        fraction = walked_mm / total
        closed.append(Point(point.x - gap.x * fraction, point.y - gap.y * fraction))
        walked_mm += edge.length_mm
    return tuple(closed)


class Projection(NamedTuple):
    """A light's projection onto an edge: the indices of both, the point, and the edge's unit vector."""

    edge: int
    light: int
    point: Point
    along: Point


def projections(ring: Ring) -> tuple[Projection, ...]:
    """Return all projections of a ring's lights, in the order of the ring."""
    nodes = corners(ring)
    result = []
    for i, edge in enumerate(ring.edges):
        here, there = nodes[i], nodes[(i + 1) % len(nodes)]
        length = math.hypot(there.x - here.x, there.y - here.y)
        along = Point((there.x - here.x) / length, (there.y - here.y) / length)
        for j, light in enumerate(edge.lights):
            fraction = light.offset_mm / edge.length_mm
            point = Point(here.x + fraction * (there.x - here.x), here.y + fraction * (there.y - here.y))
            result.append(Projection(i, j, point, along))
    return tuple(result)


def shared_lights(ring: Ring) -> tuple[Point, ...] | None:
    """Return the positions of the lights in turning spaces, or None if their projections do not pair up.

    The two projections of a light are successive along the ring, on edges that are not parallel, and the
    light is where the perpendiculars meet. As the ring may begin between the two, both pairings of neighbors
    are tried, and the one with the shorter perpendiculars is used.
    """
    projected = [p for p in projections(ring) if ring.edges[p.edge].lights[p.light].shared]
    if len(projected) % 2:
        return None
    pairings = []
    for first in (0, 1) if projected else (0,):
        meetings = [
            _meet(projected[i], projected[(i + 1) % len(projected)]) for i in range(first, len(projected), 2)
        ]
        complete = [m for m in meetings if m is not None]
        if len(complete) == len(meetings):
            pairings.append((sum(m.distance for m in complete), first, tuple(m.point for m in complete)))
    return min(pairings)[2] if pairings else None


class _Meeting(NamedTuple):
    point: Point
    distance: float


_MIN_SINE = 0.1  # edges within about six degrees of each other count as parallel


def _meet(first: Projection, second: Projection) -> _Meeting | None:
    """Return the intersection of two perpendiculars, and their total length; None for parallel edges."""
    cross = first.along.x * second.along.y - first.along.y * second.along.x
    if abs(cross) < _MIN_SINE:
        return None
    # On each perpendicular, point . along is constant: two linear equations for the common point.
    a = first.point.x * first.along.x + first.point.y * first.along.y
    b = second.point.x * second.along.x + second.point.y * second.along.y
    x = (a * second.along.y - b * first.along.y) / cross
    y = (b * first.along.x - a * second.along.x) / cross
    to_first = math.hypot(x - first.point.x, y - first.point.y)
    to_second = math.hypot(x - second.point.x, y - second.point.y)
    return _Meeting(Point(x, y), to_first + to_second)


def link_endpoints(source: Map) -> tuple[tuple[Point, Point], ...]:
    """Return the two endpoints of each link."""
    begins: dict[str, tuple[Point, Point, float]] = {}
    for ring in source.rings:
        nodes = corners(ring)
        for i, (node, edge) in enumerate(zip(ring.nodes, ring.edges, strict=True)):
            begins[node.name] = (nodes[i], nodes[(i + 1) % len(nodes)], edge.length_mm)

    def position_of(site: RingPosition) -> Point:
        here, there, length = begins[site.node]
        fraction = site.offset_mm / length
        return Point(here.x + fraction * (there.x - here.x), here.y + fraction * (there.y - here.y))

    return tuple((position_of(link.first), position_of(link.second)) for link in source.links)


def in_free_space(rings: tuple[tuple[Point, ...], ...], x: float, y: float) -> bool:
    """Return True if a point is inside an outline and outside its blocks.

    The test counts the edges to the east of the point. `rings` holds the corners of each ring, as returned by
    `corners`.
    """
    inside = False
    for nodes in rings:
        previous = nodes[-1]
        for node in nodes:
            if (node.y > y) != (previous.y > y):
                crossing = node.x + (y - node.y) / (previous.y - node.y) * (previous.x - node.x)
                inside ^= x < crossing
            previous = node
    return inside
