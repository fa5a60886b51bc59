"""Label placement for the picture of a map: names of corners, doors and elevators, behind their walls.

Every name has a few candidate positions, the best first. It takes the first at which it touches no wall or
other name, and is left out if there is none. Names are placed in order of importance: elevators, doors, then
corners.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath
from numpy.typing import NDArray

from colony.nav.maps.stickrep.geometry import Point, corners
from colony.nav.maps.stickrep.model import EdgeKind, Map
from colony.nav.maps.walls import walls_of

FONT_POINTS = 8.0
_GAP_POINTS = 3.0
_SHIFTS = ((6.0, 0.0), (6.0, 7.0), (6.0, -7.0), (17.0, 0.0), (17.0, 8.0), (17.0, -8.0))
"""Offsets of a name behind its wall and along it, in points; the best first."""
_LINE_HEIGHT = 1.25  # in font sizes
_MIN_AXIS_COMPONENT = 0.98  # of the unit normal of a wall that counts as parallel to an axis

Rank = Literal["elevator", "door", "corner"]
_RANKS: tuple[Rank, ...] = ("elevator", "door", "corner")
WEIGHTS: dict[Rank, str] = {"elevator": "bold", "door": "normal", "corner": "bold"}
"""Font weights by rank."""


class Box(NamedTuple):
    """An axis-parallel rectangle, in mm."""

    low_x: float
    low_y: float
    high_x: float
    high_y: float

    def touches(self, other: Box) -> bool:
        """Return True if the two boxes have a point in common."""
        return (
            self.low_x <= other.high_x
            and other.low_x <= self.high_x
            and self.low_y <= other.high_y
            and other.low_y <= self.high_y
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Name:
    """A placed name.

    Attributes:
        text: the name.
        rank: the kind of element that it names.
        center: the center of the text.
        upright: True if the text reads upward.
        box: the area that the text covers.
    """

    text: str
    rank: Rank
    center: Point
    upright: bool
    box: Box


@dataclass(frozen=True, slots=True, kw_only=True)
class _NameRequest:
    """A name to be placed: `anchor` is its door or corner, `out` the direction away from the floor."""

    text: str
    rank: Rank
    anchor: Point
    out: Point
    line: tuple[int, int]  # ring and side, so that names on one wall have the same orientation


def place_names(map_: Map, mm_per_point: float) -> tuple[Name, ...]:
    """Place the names of a map's doors, elevators and corners where there is space.

    Args:
        map_: the map.
        mm_per_point: millimeters of the building per typographical point.
    """
    walls = walls_of(map_).segments
    requests = sorted(_requests(map_), key=lambda r: _RANKS.index(r.rank))
    upright_lines = _crowded_lines(requests, mm_per_point)
    placed_boxes: list[Box] = []
    placed: list[Name] = []
    for request in requests:
        for upright, center, box in _candidates(request, request.line in upright_lines, mm_per_point):
            if not any(box.touches(other) for other in placed_boxes) and not _overlaps_wall(box, walls):
                placed_boxes.append(box)
                placed.append(
                    Name(text=request.text, rank=request.rank, center=center, upright=upright, box=box)
                )
                break
    return tuple(placed)


def _requests(map_: Map) -> Iterator[_NameRequest]:
    elevator_files = {elevator.node: elevator.file for elevator in reversed(map_.elevators)}
    for i, ring in enumerate(map_.rings):
        nodes, side = corners(ring), 0
        for j, (node, edge) in enumerate(zip(ring.nodes, ring.edges, strict=True)):
            here, there, last = nodes[j], nodes[(j + 1) % len(nodes)], nodes[j - 1]
            after, before = _left_of(here, there), _left_of(last, here)
            side += node.turn_deg != 0.0
            if node.corner:
                out = Point(after.x + before.x, after.y + before.y)
                yield _NameRequest(text=node.name, rank="corner", anchor=here, out=out, line=(i, side))
            if edge.kind is not EdgeKind.WALL:
                center = Point((here.x + there.x) / 2, (here.y + there.y) / 2)
                text = _without_side(node.name)
                if node.name in elevator_files:
                    text += f" ↕ {elevator_files[node.name].rpartition('/')[2].removesuffix('.stickrep')}"
                rank: Rank = "elevator" if edge.kind is EdgeKind.ELEVATOR else "door"
                yield _NameRequest(text=text, rank=rank, anchor=center, out=after, line=(i, side))


def _without_side(name: str) -> str:
    """Return a door's name from that of its left jamb: `101L` gives `101`, `NE.men.L` gives `NE.men`."""
    return name[:-1].removesuffix(".") if len(name.rstrip("L.")) > 0 and name[-1] == "L" else name


def _left_of(here: Point, there: Point) -> Point:
    """Return the unit vector to the back of a wall, which is on its left as traced."""
    length = math.hypot(there.x - here.x, there.y - here.y)
    return Point(-(there.y - here.y) / length, (there.x - here.x) / length)


def _crowded_lines(requests: Sequence[_NameRequest], mm_per_point: float) -> set[tuple[int, int]]:
    """Return the east-west walls on which the names of the doors do not fit side by side."""
    crowded = set()
    requests_by_line: dict[tuple[int, int], list[_NameRequest]] = {}
    for request in requests:
        if request.rank != "corner" and abs(request.out.y) > _MIN_AXIS_COMPONENT:
            requests_by_line.setdefault(request.line, []).append(request)
    for line, names in requests_by_line.items():
        names.sort(key=lambda r: r.anchor.x)
        for left, right in pairwise(names):
            min_distance = (_width(left.text, left.rank) + _width(right.text, right.rank)) / 2 + _GAP_POINTS
            if right.anchor.x - left.anchor.x < min_distance * mm_per_point:
                crowded.add(line)
    return crowded


@lru_cache(maxsize=1024)
def _width(text: str, rank: Rank) -> float:
    """Return the width of a name in the picture's font, in points."""
    font = FontProperties(weight=WEIGHTS[rank])
    return float(TextPath((0, 0), text, size=FONT_POINTS, prop=font).get_extents().width)


def _candidates(
    request: _NameRequest, prefer_upright: bool, mm_per_point: float
) -> Iterator[tuple[bool, Point, Box]]:
    """Yield the candidate positions of a name: True if upright, the text's center, and its area."""
    width, height = _width(request.text, request.rank), _LINE_HEIGHT * FONT_POINTS
    length = math.hypot(request.out.x, request.out.y) or 1.0
    out = Point(request.out.x / length, request.out.y / length)
    horizontal = abs(out.y) > _MIN_AXIS_COMPONENT and request.rank != "corner"
    for upright in (prefer_upright, not prefer_upright) if horizontal else (False,):
        wide, high = (height, width) if upright else (width, height)
        for gap, aside in _SHIFTS:
            shift_x = (gap + wide / 2) * out.x + aside * out.y
            shift_y = (gap + high / 2) * out.y - aside * out.x
            x = request.anchor.x + shift_x * mm_per_point
            y = request.anchor.y + shift_y * mm_per_point
            half_x, half_y = (0.5 * mm_per_point * (side + _GAP_POINTS) for side in (wide, high))
            yield upright, Point(x, y), Box(x - half_x, y - half_y, x + half_x, y + half_y)


def _overlaps_wall(box: Box, walls: NDArray[np.float64]) -> bool:
    """Return True if a box touches one of the wall segments, (n, 4) in mm."""
    low_x, high_x = np.minimum(walls[:, 0], walls[:, 2]), np.maximum(walls[:, 0], walls[:, 2])
    low_y, high_y = np.minimum(walls[:, 1], walls[:, 3]), np.maximum(walls[:, 1], walls[:, 3])
    candidates = (low_x <= box.high_x) & (high_x >= box.low_x) & (low_y <= box.high_y) & (high_y >= box.low_y)
    across_x, across_y = (
        walls[candidates, 2] - walls[candidates, 0],
        walls[candidates, 3] - walls[candidates, 1],
    )
    if not candidates.any():
        return False
    sides = [
        across_x * (y - walls[candidates, 1]) - across_y * (x - walls[candidates, 0])
        for x in (box.low_x, box.high_x)
        for y in (box.low_y, box.high_y)
    ]
    return bool(((np.min(sides, axis=0) <= 0.0) & (np.max(sides, axis=0) >= 0.0)).any())
