"""The outlines of a grid's occupied cells, as walls.

The sides between occupied cells and all others are joined to closed outlines, which have the occupied cells
on their left and so the free space on their right, as the rings of StickRep maps. Where two occupied cells
touch at a corner, the outline turns right, along both of them: they are one obstacle, without a gap.

A slanted wall is a staircase of cells. A **step** is a run of one side between two turns in opposite
directions: both of its corners are replaced by its middle. The middles of the steps of a straight wall are
within half a cell of it, whatever its slope. All other corners stay exactly where they are, so that the
corner of a room remains a right angle. The points that are left are then thinned out (Ramer, Douglas and
Peucker): the middle of no side of a cell is farther than half a cell from its wall.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

MAX_SIDES = 4_000_000
TOLERANCE = 0.5
"""Largest distance in cells from the middle of a cell's side to its wall."""

TILE = 16
"""Side in cells of the tiles by which outlines are ordered."""

_EAST, _NORTH, _WEST, _SOUTH = range(4)
_DX, _DY = np.array([1, 0, -1, 0]), np.array([0, 1, 0, -1])
_ROUNDING = 1e-9


class TooManySidesError(ValueError):
    """The outlines of a grid have more than `MAX_SIDES` sides of cells."""


def outlines(occupied: Bools) -> Floats:
    """Return the walls around occupied cells.

    Args:
        occupied: (rows, columns), the lowest row first.

    Returns:
        (n, 4) float64: x0, y0, x1, y1 in cells from the lower left corner, outline by outline; each wall of
        an outline begins where the one before it ends, the first where the last ends. The occupied cells
        are on the left.

    Raises:
        TooManySidesError: there are too many sides.
    """
    x, y, heading = _sides(occupied)
    if len(x) == 0:
        return np.empty((0, 4))
    order, first_side = _in_order(x, y, heading, occupied.shape[1] + 1)
    x, y, heading = x[order], y[order], heading[order]
    points, outline_ends = _closed(*_points(x, y, heading, first_side))
    return _walls(points.xy, _thinned(points, outline_ends), outline_ends)


def _sides(occupied: Bools) -> tuple[Ints, Ints, Ints]:
    """Return the sides of cells between occupied and other cells: where each begins, and its direction."""
    padded = np.zeros((occupied.shape[0] + 2, occupied.shape[1] + 2), dtype=np.bool_)
    padded[1:-1, 1:-1] = occupied
    above, below = padded[1:, 1:-1], padded[:-1, 1:-1]
    right, left = padded[1:-1, 1:], padded[1:-1, :-1]
    found = [np.nonzero(mask) for mask in (above & ~below, left & ~right, below & ~above, right & ~left)]
    if sum(len(rows) for rows, _ in found) > MAX_SIDES:
        raise TooManySidesError(f"the outlines have more than {MAX_SIDES:,} sides of cells")
    y = np.concatenate([rows + (heading == _SOUTH) for heading, (rows, _) in enumerate(found)])
    x = np.concatenate([columns + (heading == _WEST) for heading, (_, columns) in enumerate(found)])
    return x, y, np.repeat(np.arange(4), [len(rows) for rows, _ in found])


def _in_order(x: Ints, y: Ints, heading: Ints, row_length: int) -> tuple[Ints, Ints]:
    """Return the numbers of the sides, outline by outline, and the index at which each outline begins.

    Each outline begins with a side after a turn. Outlines that are near each other follow each other.
    """
    begins = (y * row_length + x) * 4
    by_key = np.argsort(begins + heading)
    keys = (begins + heading)[by_key]
    ends = ((y + _DY[heading]) * row_length + x + _DX[heading]) * 4
    following = np.full(len(x), -1)
    for turn in (1, 0, -1):  # to the left, straight ahead, to the right: the last that is found is taken
        wanted = ends + (heading + turn) % 4
        at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        is_found = keys[at] == wanted
        following[is_found] = by_key[at[is_found]]
    is_after_turn = np.zeros(len(x), dtype=np.bool_)
    is_after_turn[following] = heading[following] != heading
    next_side, is_done = following.tolist(), bytearray(len(x))
    order: list[int] = []
    first_side: list[int] = []
    begins_after_turn = np.flatnonzero(is_after_turn)
    tiles = _interleaved(x[begins_after_turn] // TILE, y[begins_after_turn] // TILE)
    for begin in begins_after_turn[np.argsort(tiles, kind="stable")].tolist():
        if not is_done[begin]:
            first_side.append(len(order))
            side = begin
            while not is_done[side]:
                is_done[side] = 1
                order.append(side)
                side = next_side[side]
    return np.array(order), np.array(first_side)


def _interleaved(column: Ints, row: Ints) -> Ints:
    """Return numbers of tiles, in which neighbors are mostly near each other (Morton's order)."""
    code = np.zeros(len(column), dtype=np.int64)
    for bit in range(16):
        code |= ((column >> bit) & 1) << (2 * bit) | ((row >> bit) & 1) << (2 * bit + 1)
    return code


class _Points:
    """The points of outlines: middles of sides, and the corners that stay.

    Attributes:
        xy: (n, 2), in cells.
        is_candidate: True for points at which walls may begin: corners, and middles of steps.
        is_corner: True for corners.
    """

    def __init__(self, xy: Floats, is_candidate: Bools, is_corner: Bools) -> None:
        self.xy, self.is_candidate, self.is_corner = xy, is_candidate, is_corner

    def taken(self, index: Ints) -> _Points:
        """Return the points of these numbers."""
        return _Points(self.xy[index], self.is_candidate[index], self.is_corner[index])


def _points(x: Ints, y: Ints, heading: Ints, first_side: Ints) -> tuple[_Points, Ints]:
    """Return the points of outlines, and the index at which each outline begins."""
    count = len(x)
    last_side = np.append(first_side[1:], count) - 1
    before = np.arange(count) - 1
    before[first_side] = last_side
    turn = (heading - heading[before] + 1) % 4 - 1  # 1 to the left, -1 to the right, at a side's begin
    run = np.flatnonzero(turn)
    first_run = np.searchsorted(run, first_side)
    last_run = np.append(first_run[1:], len(run)) - 1
    next_run, previous_run = np.arange(len(run)) + 1, np.arange(len(run)) - 1
    next_run[last_run], previous_run[first_run] = first_run, last_run
    length = np.diff(np.append(run, count))
    is_step = (length == 1) & (turn[run] * turn[run[next_run]] < 0)
    corners = run[~is_step & ~is_step[previous_run]]
    has_corner = np.zeros(count, dtype=np.int64)
    has_corner[corners] = 1
    middle_at = np.arange(count) + np.cumsum(has_corner)
    corner_at = middle_at[corners] - 1
    xy = np.empty((count + len(corners), 2))
    xy[middle_at, 0], xy[middle_at, 1] = x + _DX[heading] / 2.0, y + _DY[heading] / 2.0
    xy[corner_at, 0], xy[corner_at, 1] = x[corners], y[corners]
    is_corner = np.zeros(len(xy), dtype=np.bool_)
    is_corner[corner_at] = True
    is_candidate = is_corner.copy()
    is_candidate[middle_at[run[is_step]]] = True
    return _Points(xy, is_candidate, is_corner), middle_at[first_side] - has_corner[first_side]


def _closed(points: _Points, first_point: Ints) -> tuple[_Points, Ints]:
    """Begin each outline at a corner, or else at a step, and repeat this point at its end.

    Returns:
        The points, and the index at which each outline ends.
    """
    count = np.diff(np.append(first_point, len(points.xy)))
    preference = points.is_corner.astype(np.int64) * 2 + points.is_candidate
    best = np.repeat(np.maximum.reduceat(preference, first_point), count)
    anchors = np.flatnonzero(preference == best)
    anchor = anchors[np.searchsorted(anchors, first_point)]
    outline = np.repeat(np.arange(len(count)), count + 1)
    ends = np.cumsum(count + 1) - 1
    along = np.arange(len(outline)) - (ends - count)[outline]
    index = first_point[outline] + (anchor[outline] - first_point[outline] + along) % count[outline]
    return points.taken(index), ends


def _thinned(points: _Points, ends: Ints) -> Bools:
    """Return a mask of the points at which walls begin or end."""
    keep = points.is_corner.copy()
    keep[ends] = True
    keep[0] = True
    keep[ends[:-1] + 1] = True
    kept = np.flatnonzero(keep)
    starts, stops = kept[:-1], kept[1:]
    is_outline = ~np.isin(starts, ends)  # not from the end of an outline to the begin of the next
    starts, stops = starts[is_outline], stops[is_outline]
    while True:
        has_inner = stops - starts > 1
        starts, stops = starts[has_inner], stops[has_inner]
        if len(starts) == 0:
            return keep
        split = _farthest_candidates(points, starts, stops)
        is_split = split >= 0
        starts, stops, split = starts[is_split], stops[is_split], split[is_split]
        keep[split] = True
        starts, stops = np.concatenate([starts, split]), np.concatenate([split, stops])


def _farthest_candidates(points: _Points, starts: Ints, stops: Ints) -> Ints:
    """Return the candidate that is farthest from each wall, or -1 if all points are near enough to it."""
    count = stops - starts - 1
    wall = np.repeat(np.arange(len(starts)), count)
    first = np.cumsum(count) - count
    inner = np.arange(len(wall)) - first[wall] + starts[wall] + 1
    distance = _distances(points.xy[inner], points.xy[starts][wall], points.xy[stops][wall])
    is_far = np.maximum.reduceat(distance, first) > TOLERANCE + _ROUNDING
    distance[~points.is_candidate[inner]] = -1.0
    farthest = np.maximum.reduceat(distance, first)
    at = np.flatnonzero(distance == farthest[wall])
    split = inner[at[np.searchsorted(at, first)]]
    return np.where(is_far & (farthest >= 0.0), split, -1)


def _distances(xy: Floats, begin: Floats, end: Floats) -> Floats:
    """Return the distance of each point to a segment."""
    dx, dy = (end - begin).T
    x, y = (xy - begin).T
    squared = dx * dx + dy * dy
    along = np.clip((x * dx + y * dy) / np.where(squared > 0.0, squared, 1.0), 0.0, 1.0)
    distances: Floats = np.hypot(x - along * dx, y - along * dy)
    return distances


def _walls(xy: Floats, keep: Bools, ends: Ints) -> Floats:
    kept = np.flatnonzero(keep)
    starts, stops = kept[:-1], kept[1:]
    is_outline = ~np.isin(starts, ends)
    walls: Floats = np.hstack([xy[starts[is_outline]], xy[stops[is_outline]]])
    has_length: Bools = (walls[:, :2] != walls[:, 2:]).any(axis=1)
    proper: Floats = walls[has_length]
    return proper
