"""The places of a ring's nodes and shared lights: plane geometry on StickRep, without arrays.

A ring is stored as turns and lengths, and lengths are counted in bricks: traced once around, it rarely ends
exactly where it began. The gap is distributed by the compass rule, as surveyors do in a closed traverse: each
edge takes a share in proportion to its length. Walls then have no gaps, and no node moves by more than the
original one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from colony.nav.maps.stickrep.model import Map, Ring, Site

_EXACT = {0.0: (0.0, 1.0), 90.0: (-1.0, 0.0), 180.0: (0.0, -1.0), 270.0: (1.0, 0.0)}


class Point(NamedTuple):
    """A place in mm: x east, y north."""

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
class Trace:
    """A ring walked once around, before its gap is closed.

    Attributes:
        points: places of the nodes, and the end of the last edge.
        headings_deg: headings of the edges, in [0, 360).
        total_turn_deg: the sum of all turns; -360 for an outline, 360 for a block, if the ring is sound.
    """

    points: tuple[Point, ...]
    headings_deg: tuple[float, ...]
    total_turn_deg: float

    @property
    def gap(self) -> Point:
        """Vector from the first node to the end of the last edge, in mm."""
        return Point(self.points[-1].x - self.points[0].x, self.points[-1].y - self.points[0].y)


def trace(ring: Ring) -> Trace:
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
    return Trace(
        points=tuple(points),
        headings_deg=tuple(headings),
        total_turn_deg=sum(node.turn_deg for node in ring.nodes),
    )


def corners(ring: Ring) -> tuple[Point, ...]:
    """Return the places of a ring's nodes, in mm, with its gap spread over it by the compass rule."""
    walked = trace(ring)
    gap = walked.gap
    total = math.fsum(edge.length_mm for edge in ring.edges)
    placed, so_far = [], 0.0
    for point, edge in zip(walked.points, ring.edges, strict=False):
        share = so_far / total
        placed.append(Point(point.x - gap.x * share, point.y - gap.y * share))
        so_far += edge.length_mm
    return tuple(placed)


class Projection(NamedTuple):
    """A light's projection onto an edge: indices of edge and light, its place, and the edge's unit vector."""

    edge: int
    light: int
    at: Point
    along: Point


def projections(ring: Ring) -> tuple[Projection, ...]:
    """Return all projections of a ring's lights, in the order of the ring."""
    nodes = corners(ring)
    out = []
    for i, edge in enumerate(ring.edges):
        here, there = nodes[i], nodes[(i + 1) % len(nodes)]
        length = math.hypot(there.x - here.x, there.y - here.y)
        along = Point((there.x - here.x) / length, (there.y - here.y) / length)
        for j, light in enumerate(edge.lights):
            part = light.offset_mm / edge.length_mm
            at = Point(here.x + part * (there.x - here.x), here.y + part * (there.y - here.y))
            out.append(Projection(i, j, at, along))
    return tuple(out)


def shared_lights(ring: Ring) -> tuple[Point, ...] | None:
    """Return the places of the lights in turning spaces, or None if their projections do not pair up.

    The two projections of a light are successive along the ring, on edges that are not parallel, and the
    light is where the perpendiculars meet. As the ring may begin between the two, both pairings of neighbors
    are tried; the one with the shorter perpendiculars is taken.
    """
    marks = [p for p in projections(ring) if ring.edges[p.edge].lights[p.light].shared]
    if len(marks) % 2:
        return None
    ways = []
    for first in (0, 1) if marks else (0,):
        found = [_meet(marks[i], marks[(i + 1) % len(marks)]) for i in range(first, len(marks), 2)]
        complete = [f for f in found if f is not None]
        if len(complete) == len(found):
            ways.append((sum(f.distance for f in complete), first, tuple(f.at for f in complete)))
    return min(ways)[2] if ways else None


class _Meeting(NamedTuple):
    at: Point
    distance: float


_MIN_SINE = 0.1  # edges that differ by less than about six degrees are as good as parallel


def _meet(one: Projection, other: Projection) -> _Meeting | None:
    """Return where the perpendiculars of two edges meet, and their total length; None for parallel edges."""
    cross = one.along.x * other.along.y - one.along.y * other.along.x
    if abs(cross) < _MIN_SINE:
        return None
    # at . along is fixed on each perpendicular: two linear equations for the common point.
    a = one.at.x * one.along.x + one.at.y * one.along.y
    b = other.at.x * other.along.x + other.at.y * other.along.y
    x = (a * other.along.y - b * one.along.y) / cross
    y = (b * one.along.x - a * other.along.x) / cross
    distance = math.hypot(x - one.at.x, y - one.at.y) + math.hypot(x - other.at.x, y - other.at.y)
    return _Meeting(Point(x, y), distance)


def link_places(source: Map) -> tuple[tuple[Point, Point], ...]:
    """Return the two places of each link."""
    begins: dict[str, tuple[Point, Point, float]] = {}
    for ring in source.rings:
        nodes = corners(ring)
        for i, (node, edge) in enumerate(zip(ring.nodes, ring.edges, strict=True)):
            begins[node.name] = (nodes[i], nodes[(i + 1) % len(nodes)], edge.length_mm)

    def place(site: Site) -> Point:
        here, there, length = begins[site.node]
        part = site.offset_mm / length
        return Point(here.x + part * (there.x - here.x), here.y + part * (there.y - here.y))

    return tuple((place(link.first), place(link.second)) for link in source.links)


def in_free_space(rings: tuple[tuple[Point, ...], ...], x: float, y: float) -> bool:
    """Return True if a place is inside an outline and outside its blocks, by the edges to its east.

    `rings` holds the corners of each ring, as `corners` gives them.
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
