"""A map as plain geometry: wall segments and ceiling lights in the plane, for simulation and drawing."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.stickrep.geometry import Point, corners, projections, shared_lights
from colony.nav.maps.stickrep.model import EdgeKind, Map

_GLASS = re.compile(r"\bglass\b(?![ -]?(brick|block)s?\b)", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Walls:
    """The edges of a map as segments.

    Attributes:
        segments: (n, 4) float64, read-only: x0, y0, x1, y1 in mm, x east and y north, in the order of the
            map. The free space lies to the right of each; each ring is closed exactly.
        kinds: the kind of each segment.
        attributes: the map's remark on each segment's surface, such as "wood, room 12", or "".
    """

    segments: NDArray[np.float64]
    kinds: tuple[EdgeKind, ...]
    attributes: tuple[str, ...]

    @property
    def glass(self) -> tuple[bool, ...]:
        """True for panes of glass, which sonars may miss: segments with `glass` in the remark.

        Glass bricks do not count: sonars detect their rough surface.
        """
        return tuple(_GLASS.search(attribute) is not None for attribute in self.attributes)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """The minimum x and y, and the maximum x and y, in mm."""
        x, y = self.segments[:, 0::2], self.segments[:, 1::2]
        return float(x.min()), float(y.min()), float(x.max()), float(y.max())


def walls_of(source: Map) -> Walls:
    """Return the walls, doors and elevators of a map; doors and elevators are closed."""
    rows = []
    for ring in source.rings:
        nodes = corners(ring)
        rows += [(*here, *there) for here, there in zip(nodes, (*nodes[1:], nodes[0]), strict=True)]
    segments = np.array(rows, dtype=np.float64).reshape(-1, 4)
    segments.flags.writeable = False
    return Walls(
        segments=segments,
        kinds=tuple(edge.kind for edge in source.edges()),
        attributes=tuple(edge.attribute for edge in source.edges()),
    )


_HALF_CORRIDOR_MM = 1200.0
_MIN_DISTANCE_MM = 1.0
_MAX_WIDTH_MM = 4500.0
_BESIDE_MM = tuple(step * 500.0 for k in range(1, 9) for step in (k, -k))


def lights_of(source: Map) -> NDArray[np.float64]:
    """Return the positions of the ceiling lights: (n, 2) float64, x and y in mm.

    A light projected onto one edge hangs half-way between the edge and the opposite wall; where another
    corridor begins opposite, the walls next to its mouth count. A light projected onto two edges hangs where
    the perpendiculars meet. The lights of the corridors come first, in the order of the map, then those of
    the turning spaces.
    """
    segments = walls_of(source).segments
    positions: list[Point] = []
    for ring in source.rings:
        for mark in projections(ring):
            if not ring.edges[mark.edge].lights[mark.light].shared:
                away = Point(mark.along.y, -mark.along.x)
                half = _width(segments, mark.point, mark.along, away) / 2
                positions.append(Point(mark.point.x + half * away.x, mark.point.y + half * away.y))
    for ring in source.rings:
        positions += shared_lights(ring) or ()
    return np.array(positions, dtype=np.float64).reshape(-1, 2)


def _width(segments: NDArray[np.float64], point: Point, along: Point, away: Point) -> float:
    """Return the width of the corridor at a point on a wall, in mm."""
    opposite = free_distance(segments, point, away)
    if opposite <= _MAX_WIDTH_MM:
        return opposite
    neighbors = [Point(point.x + step * along.x, point.y + step * along.y) for step in _BESIDE_MM]
    width = min(opposite, *(free_distance(segments, neighbor, away) for neighbor in neighbors))
    return width if math.isfinite(width) else 2 * _HALF_CORRIDOR_MM


def free_distance(
    segments: NDArray[np.float64], origin: Point, ray: Point, min_mm: float = _MIN_DISTANCE_MM
) -> float:
    """Return the distance at which a ray hits the first wall, in mm; inf if it hits none.

    Args:
        segments: (n, 4) as in `Walls`.
        origin: start of the ray, in mm.
        ray: unit vector of the direction.
        min_mm: distance below which walls do not count, as the origin may be on one.
    """
    ax, ay = segments[:, 0] - origin.x, segments[:, 1] - origin.y
    ex, ey = segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        across = ray.x * ey - ray.y * ex
        distance = (ax * ey - ay * ex) / across
        fraction = (ax * ray.y - ay * ray.x) / across
    hit = (distance > min_mm) & (fraction >= 0.0) & (fraction <= 1.0)
    return float(distance[hit].min()) if hit.any() else math.inf


def point_on(wall: Sequence[float], along_mm: float) -> Point:
    """Return the point on a wall, (x0, y0, x1, y1), at a distance from its start."""
    x0, y0, x1, y1 = wall
    length = math.hypot(x1 - x0, y1 - y0)
    return Point(x0 + (x1 - x0) * along_mm / length, y0 + (y1 - y0) * along_mm / length)


def facing_deg(wall: Sequence[float]) -> float:
    """Return the heading of a robot that faces a wall from its free side, the right side."""
    x0, y0, x1, y1 = wall
    return (math.degrees(math.atan2(-(x1 - x0), y1 - y0)) + 90.0) % 360.0
