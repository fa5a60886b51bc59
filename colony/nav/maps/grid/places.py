"""Places in a grid where a robot can stand, and where it can get to from there.

A robot stands in free space only. The walls of a grid are around its occupied cells; unknown cells, and what
is beyond the image, are no walls, but nobody knows that a robot could stand there.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.grid.model import Grid, GridCell

_WALL_SHIFT_CELLS = 1.0  # walls may be so much farther in than the cells around which they are


def clearance_mm(grid: Grid, walls: NDArray[np.float64], x_mm: float, y_mm: float, limit_mm: float) -> float:
    """Return the distance of a place to the nearest wall or cell that is unknown, at most `limit_mm`.

    It is 0 in an occupied cell, however far the walls around it are.

    Args:
        grid: the grid.
        walls: (n, 4), its walls in mm.
        x_mm: x of the place.
        y_mm: y of the place.
        limit_mm: beyond this distance nothing is looked at.
    """
    if grid.state_at(x_mm, y_mm) is GridCell.OCCUPIED:
        return 0.0
    place = np.array([x_mm, y_mm])
    nearest = _unknown_distance(grid, grid.to_cells(place), limit_mm / grid.cell_mm) * grid.cell_mm
    along = walls[:, 2:] - walls[:, :2]
    squared = np.maximum((along * along).sum(axis=1), 1e-12)
    start = walls[:, :2] - place
    fraction = np.clip(-(start * along).sum(axis=1) / squared, 0.0, 1.0)
    gaps = np.hypot(*(start + fraction[:, None] * along).T)
    return min(limit_mm, nearest, float(gaps.min(initial=math.inf)))


def nearest_place(
    grid: Grid, radius_mm: float, among: NDArray[np.bool_] | None = None
) -> tuple[float, float] | None:
    """Return the center of the cell nearest to (0, 0) where a robot fits, x and y in mm; None without one.

    `among` is a mask of the cells that count, (rows, columns); by default all do.
    """
    with_room = cells_with_room(grid, radius_mm)
    rows, columns = np.nonzero(with_room if among is None else with_room & among)
    if len(rows) == 0:
        return None
    places = grid.to_world(np.stack([columns + 0.5, rows + 0.5], axis=-1))
    x, y = places[np.argmin((places * places).sum(axis=1))].tolist()
    return x, y


def cells_with_room(grid: Grid, radius_mm: float) -> NDArray[np.bool_]:
    """Return a mask of the cells, (rows, columns), in whose centers a robot fits."""
    reach = radius_mm / grid.cell_mm + math.sqrt(0.5) + _WALL_SHIFT_CELLS
    return ~_dilated(grid.cells != GridCell.FREE, reach)


class ReachableRegions:
    """The regions of a grid in which a robot can move without touching cells that are not free.

    Half a cell of such cells is allowed for: a way that is closed here is closed to the robot.

    Args:
        grid: the grid.
        radius_mm: the radius of the robot.
    """

    def __init__(self, grid: Grid, radius_mm: float) -> None:
        self._grid, self._cells = grid, radius_mm / grid.cell_mm
        self._regions = labeled(~_dilated(grid.cells != GridCell.FREE, self._cells))

    def region(self, x_mm: float, y_mm: float) -> int:
        """Return the region of a place, which may be half a cell beside it; 0 if it is in none."""
        column, row = (self._grid.to_cells(np.array([x_mm, y_mm])) - 0.5).tolist()
        near = self._regions[
            max(math.floor(row), 0) : math.floor(row) + 2, max(math.floor(column), 0) : math.floor(column) + 2
        ]
        return int(near.max(initial=0))

    @cached_property
    def largest(self) -> int:
        """The region with the most cells; 0 without any."""
        counts = np.bincount(self._regions.ravel())
        counts[0] = 0
        return int(counts.argmax())

    def cells(self, region: int) -> NDArray[np.bool_]:
        """Return a mask of the cells in which the robot's center can be in a region, (rows, columns)."""
        within: NDArray[np.bool_] = self._regions == region
        return within if region else np.zeros_like(within)

    def share(self, region: int) -> float:
        """Return the share of all free cells that the robot can cover in a region, from 0 to 1."""
        free = self._grid.cells == GridCell.FREE
        covered = _dilated(self.cells(region), self._cells, border=False)
        return float(np.count_nonzero(covered & free)) / max(float(np.count_nonzero(free)), 1.0)


def labeled(mask: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return the number of each cell's region, from 1, and 0 where the mask is False.

    The cells of a region touch at sides. Each row is cut into runs, and runs of neighboring rows that overlap
    get the lower of their numbers until all agree.
    """
    rows, columns = mask.shape
    padded = np.zeros((rows, columns + 1), dtype=np.int8)
    padded[:, :columns] = mask
    steps = np.diff(padded.ravel(), prepend=np.int8(0))
    starts, ends = np.nonzero(steps == 1)[0], np.nonzero(steps == -1)[0]
    first = np.searchsorted(ends, starts + columns + 1, "right")
    last = np.searchsorted(starts, ends + columns + 1, "left")
    counts = np.maximum(last - first, 0)
    above = np.repeat(np.arange(len(starts)), counts)
    below = np.arange(len(above)) + np.repeat(first - (np.cumsum(counts) - counts), counts)
    labels = np.arange(len(starts))
    while (labels[above] != labels[below]).any():
        lower = np.minimum(labels[above], labels[below])
        np.minimum.at(labels, labels[above], lower)
        np.minimum.at(labels, labels[below], lower)
        while (labels[labels] != labels).any():
            labels = labels[labels]
    numbers = np.unique(labels, return_inverse=True)[1].astype(np.int32) + 1
    regions = np.zeros((rows, columns), dtype=np.int32)
    regions[mask] = np.repeat(numbers, ends - starts)
    return regions


def _unknown_distance(grid: Grid, place: NDArray[np.float64], limit: float) -> float:
    """Return the distance to the nearest cell that is unknown or beyond the image, in cells."""
    rows, columns = grid.cells.shape
    (x, y), reach = place.tolist(), math.ceil(limit) + 1
    nearest: float = min(x, y, columns - x, rows - y)
    if nearest <= 0.0:
        return 0.0
    first_row, first_column = max(int(y) - reach, 0), max(int(x) - reach, 0)
    window = grid.cells[first_row : int(y) + reach + 1, first_column : int(x) + reach + 1]
    row, column = np.nonzero(window == GridCell.UNKNOWN)
    dx = np.maximum(np.abs(column + first_column + 0.5 - x) - 0.5, 0.0)
    dy = np.maximum(np.abs(row + first_row + 0.5 - y) - 0.5, 0.0)
    return min(nearest, float(np.hypot(dx, dy).min(initial=math.inf)))


def _dilated(blocked: NDArray[np.bool_], reach: float, *, border: bool = True) -> NDArray[np.bool_]:
    """Return a mask of the cells whose center is within `reach` of a blocked one's, or of the border."""
    rows, columns = blocked.shape
    margin = math.floor(reach)
    counts = np.zeros((rows + 2 * margin, columns + 2 * margin + 1), dtype=np.int32)
    padded = np.full((rows + 2 * margin, columns + 2 * margin), border)
    padded[margin : margin + rows, margin : margin + columns] = blocked
    np.cumsum(padded, axis=1, out=counts[:, 1:])
    near = np.zeros_like(blocked)
    for dy in range(-margin, margin + 1):
        half = math.floor(math.sqrt(reach * reach - dy * dy))
        lines = counts[margin + dy : margin + dy + rows]
        low, high = margin - half, margin + half + 1
        near |= lines[:, high : high + columns] > lines[:, low : low + columns]
    return near
