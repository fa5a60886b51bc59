"""Label placement for the picture of a map: names of corners, doors and elevators, behind their walls.

Every name has a few candidate places, the best first. It takes the first one where it touches no wall and no
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
"""Distances of a name behind its wall and along it, in points; the best first."""
_HEIGHT = 1.25  # of a line of text, in font sizes
_AXIS = 0.98  # minimum component of a wall's direction along an axis to count as parallel to it

Rank = Literal["elevator", "door", "corner"]
_RANKS: tuple[Rank, ...] = ("elevator", "door", "corner")
WEIGHTS: dict[Rank, str] = {"elevator": "bold", "door": "normal", "corner": "bold"}
"""Weight of the font, for each rank."""


class Box(NamedTuple):
    """A part of the plane, in mm."""

    low_x: float
    low_y: float
    high_x: float
    high_y: float

    def touches(self, other: Box) -> bool:
        """Return True if the two have a point in common."""
        return (
            self.low_x <= other.high_x
            and other.low_x <= self.high_x
            and self.low_y <= other.high_y
            and other.low_y <= self.high_y
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Name:
    """A placed name: its text, its center, and True for `upright` if it reads upward.

    `box` is the area that it takes.
    """

    text: str
    rank: Rank
    at: Point
    upright: bool
    box: Box


@dataclass(frozen=True, slots=True, kw_only=True)
class _NameRequest:
    """A name to be placed: the place of its door or corner, and the direction behind the wall (`out`)."""

    text: str
    rank: Rank
    at: Point
    out: Point
    line: tuple[int, int]  # ring and side, so that neighboring names have one orientation


def place_names(drawn: Map, mm_per_point: float) -> tuple[Name, ...]:
    """Place the names of a map's doors, elevators and corners where there is room.

    Args:
        drawn: the map.
        mm_per_point: millimeters of the building per typographical point.
    """
    walls = walls_of(drawn).segments
    wanted = sorted(_wanted(drawn), key=lambda w: _RANKS.index(w.rank))
    turned = _crowded_lines(wanted, mm_per_point)
    taken: list[Box] = []
    placed: list[Name] = []
    for one in wanted:
        for upright, at, box in _places(one, one.line in turned, mm_per_point):
            if not any(box.touches(other) for other in taken) and not _meets_wall(box, walls):
                taken.append(box)
                placed.append(Name(text=one.text, rank=one.rank, at=at, upright=upright, box=box))
                break
    return tuple(placed)


def _wanted(drawn: Map) -> Iterator[_NameRequest]:
    leads = {elevator.node: elevator.file for elevator in reversed(drawn.elevators)}
    for i, ring in enumerate(drawn.rings):
        nodes, side = corners(ring), 0
        for j, (node, edge) in enumerate(zip(ring.nodes, ring.edges, strict=True)):
            here, there, last = nodes[j], nodes[(j + 1) % len(nodes)], nodes[j - 1]
            after, before = _left_of(here, there), _left_of(last, here)
            side += node.turn_deg != 0.0
            if node.corner:
                out = Point(after.x + before.x, after.y + before.y)
                yield _NameRequest(text=node.name, rank="corner", at=here, out=out, line=(i, side))
            if edge.kind is not EdgeKind.WALL:
                middle = Point((here.x + there.x) / 2, (here.y + there.y) / 2)
                text = _without_side(node.name)
                if node.name in leads:
                    text += f" ↕ {leads[node.name].rpartition('/')[2].removesuffix('.stickrep')}"
                rank: Rank = "elevator" if edge.kind is EdgeKind.ELEVATOR else "door"
                yield _NameRequest(text=text, rank=rank, at=middle, out=after, line=(i, side))


def _without_side(name: str) -> str:
    """Return a door's name from that of its left jamb: `101L` gives `101`, `NE.men.L` gives `NE.men`."""
    return name[:-1].removesuffix(".") if len(name.rstrip("L.")) > 0 and name[-1] == "L" else name


def _left_of(here: Point, there: Point) -> Point:
    """Return the unit vector to the back of a wall, on its left as traced."""
    length = math.hypot(there.x - here.x, there.y - here.y)
    return Point(-(there.y - here.y) / length, (there.x - here.x) / length)


def _crowded_lines(wanted: Sequence[_NameRequest], mm_per_point: float) -> set[tuple[int, int]]:
    """Return the walls from west to east on which the names of the doors do not fit side by side."""
    crowded = set()
    along: dict[tuple[int, int], list[_NameRequest]] = {}
    for one in wanted:
        if one.rank != "corner" and abs(one.out.y) > _AXIS:
            along.setdefault(one.line, []).append(one)
    for line, names in along.items():
        names.sort(key=lambda w: w.at.x)
        for left, right in pairwise(names):
            room = (_width(left.text, left.rank) + _width(right.text, right.rank)) / 2 + _GAP_POINTS
            if right.at.x - left.at.x < room * mm_per_point:
                crowded.add(line)
    return crowded


@lru_cache(maxsize=1024)
def _width(text: str, rank: Rank) -> float:
    """Return the width of a name in the picture's font, in points."""
    font = FontProperties(weight=WEIGHTS[rank])
    return float(TextPath((0, 0), text, size=FONT_POINTS, prop=font).get_extents().width)


def _places(one: _NameRequest, turned: bool, mm_per_point: float) -> Iterator[tuple[bool, Point, Box]]:
    """Yield the candidate places of a name: True if upright, its center, and the area that it takes."""
    width, height = _width(one.text, one.rank), _HEIGHT * FONT_POINTS
    length = math.hypot(one.out.x, one.out.y) or 1.0
    out = Point(one.out.x / length, one.out.y / length)
    horizontal = abs(out.y) > _AXIS and one.rank != "corner"
    for upright in (turned, not turned) if horizontal else (False,):
        wide, high = (height, width) if upright else (width, height)
        for gap, aside in _SHIFTS:
            reach_x = (gap + wide / 2) * out.x + aside * out.y
            reach_y = (gap + high / 2) * out.y - aside * out.x
            at = Point(one.at.x + reach_x * mm_per_point, one.at.y + reach_y * mm_per_point)
            half_x, half_y = (0.5 * mm_per_point * (side + _GAP_POINTS) for side in (wide, high))
            yield upright, at, Box(at.x - half_x, at.y - half_y, at.x + half_x, at.y + half_y)


def _meets_wall(box: Box, walls: NDArray[np.float64]) -> bool:
    """Return True if a box touches one of the wall segments, (n, 4) in mm."""
    low_x, high_x = np.minimum(walls[:, 0], walls[:, 2]), np.maximum(walls[:, 0], walls[:, 2])
    low_y, high_y = np.minimum(walls[:, 1], walls[:, 3]), np.maximum(walls[:, 1], walls[:, 3])
    near = (low_x <= box.high_x) & (high_x >= box.low_x) & (low_y <= box.high_y) & (high_y >= box.low_y)
    across_x, across_y = walls[near, 2] - walls[near, 0], walls[near, 3] - walls[near, 1]
    if not near.any():
        return False
    sides = [
        across_x * (y - walls[near, 1]) - across_y * (x - walls[near, 0])
        for x in (box.low_x, box.high_x)
        for y in (box.low_y, box.high_y)
    ]
    return bool(((np.min(sides, axis=0) <= 0.0) & (np.max(sides, axis=0) >= 0.0)).any())
