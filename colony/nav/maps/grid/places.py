"""Places in a grid where a robot can stand.

A robot stands in free space only. The walls of a grid are around its occupied cells; unknown cells, and what
is beyond the image, are no walls, but nobody knows that a robot could stand there.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.grid.model import Cell, Grid

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
    if grid.state_at(x_mm, y_mm) is Cell.OCCUPIED:
        return 0.0
    place = np.array([x_mm, y_mm])
    nearest = _unknown_distance(grid, grid.to_cells(place), limit_mm / grid.cell_mm) * grid.cell_mm
    along = walls[:, 2:] - walls[:, :2]
    squared = np.maximum((along * along).sum(axis=1), 1e-12)
    start = walls[:, :2] - place
    fraction = np.clip(-(start * along).sum(axis=1) / squared, 0.0, 1.0)
    gaps = np.hypot(*(start + fraction[:, None] * along).T)
    return min(limit_mm, nearest, float(gaps.min(initial=math.inf)))


def nearest_place(grid: Grid, radius_mm: float) -> tuple[float, float] | None:
    """Return the center of the cell nearest to (0, 0) where a robot fits, x and y in mm; None without one."""
    rows, columns = np.nonzero(cells_with_room(grid, radius_mm))
    if len(rows) == 0:
        return None
    places = grid.to_world(np.stack([columns + 0.5, rows + 0.5], axis=-1))
    x, y = places[np.argmin((places * places).sum(axis=1))].tolist()
    return x, y


def cells_with_room(grid: Grid, radius_mm: float) -> NDArray[np.bool_]:
    """Return a mask of the cells, (rows, columns), in whose centers a robot fits."""
    reach = radius_mm / grid.cell_mm + math.sqrt(0.5) + _WALL_SHIFT_CELLS
    return ~_dilated(grid.cells != Cell.FREE, reach)


def _unknown_distance(grid: Grid, place: NDArray[np.float64], limit: float) -> float:
    """Return the distance to the nearest cell that is unknown or beyond the image, in cells."""
    rows, columns = grid.cells.shape
    (x, y), reach = place.tolist(), math.ceil(limit) + 1
    nearest: float = min(x, y, columns - x, rows - y)
    if nearest <= 0.0:
        return 0.0
    first_row, first_column = max(int(y) - reach, 0), max(int(x) - reach, 0)
    window = grid.cells[first_row : int(y) + reach + 1, first_column : int(x) + reach + 1]
    row, column = np.nonzero(window == Cell.UNKNOWN)
    dx = np.maximum(np.abs(column + first_column + 0.5 - x) - 0.5, 0.0)
    dy = np.maximum(np.abs(row + first_row + 0.5 - y) - 0.5, 0.0)
    return min(nearest, float(np.hypot(dx, dy).min(initial=math.inf)))


def _dilated(blocked: NDArray[np.bool_], reach: float) -> NDArray[np.bool_]:
    """Return a mask of the cells whose center is within `reach` of a blocked one's, or of the border."""
    rows, columns = blocked.shape
    margin = math.floor(reach)
    counts = np.zeros((rows + 2 * margin, columns + 2 * margin + 1), dtype=np.int32)
    padded = np.ones((rows + 2 * margin, columns + 2 * margin), dtype=np.bool_)
    padded[margin : margin + rows, margin : margin + columns] = blocked
    np.cumsum(padded, axis=1, out=counts[:, 1:])
    near = np.zeros_like(blocked)
    for dy in range(-margin, margin + 1):
        half = math.floor(math.sqrt(reach * reach - dy * dy))
        lines = counts[margin + dy : margin + dy + rows]
        low, high = margin - half, margin + half + 1
        near |= lines[:, high : high + columns] > lines[:, low : low + columns]
    return near
