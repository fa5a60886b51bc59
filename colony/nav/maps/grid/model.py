"""Occupancy grids: cells that are free, occupied or unknown, and their place in the world.

ROS and this project agree on x east and y north. ROS has meters and angles counterclockwise from x; here
are millimeters, and headings counterclockwise from north, in degrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.stickrep.model import Pose

Floats = NDArray[np.float64]


class GridCell(IntEnum):
    """The state of a cell."""

    FREE = 0
    OCCUPIED = 1
    UNKNOWN = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grid:
    """A map as a grid of square cells.

    Attributes:
        name: the name of the map: that of its file.
        image: the path of its image.
        cells: (rows, columns) uint8, read-only, of `GridCell`; row 0 is the lowest of the image.
        cell_mm: the length of a cell's side.
        x_mm, y_mm: the lower left corner of the cell in row 0 and column 0.
        yaw_deg: the angle from x to the direction of the rows, counterclockwise.
        docks: the poses of robots at charging docks.
        remarks: why a state is that of no cell, as sentences without a period.
    """

    name: str
    image: str
    cells: NDArray[np.uint8]
    cell_mm: float
    x_mm: float
    y_mm: float
    yaw_deg: float
    docks: tuple[Pose, ...] = ()
    remarks: tuple[str, ...] = ()

    def state_at(self, x_mm: float, y_mm: float) -> GridCell:
        """Return the state of the cell at a place; what is beyond the image is unknown."""
        column, row = np.floor(self.to_cells(np.array([x_mm, y_mm]))).astype(int).tolist()
        return GridCell(self.cells[row, column]) if self.contains(x_mm, y_mm) else GridCell.UNKNOWN

    def contains(self, x_mm: float, y_mm: float) -> bool:
        """Return True if a place is within the image."""
        column, row = self.to_cells(np.array([x_mm, y_mm])).tolist()
        rows, columns = self.cells.shape
        return bool(0.0 <= row < rows and 0.0 <= column < columns)

    @property
    def size_mm(self) -> tuple[float, float]:
        """The length of a row, and that of a column."""
        rows, columns = self.cells.shape
        return columns * self.cell_mm, rows * self.cell_mm

    def area_m2(self, state: GridCell) -> float:
        """Return the area of all cells in a state."""
        return float(np.count_nonzero(self.cells == state)) * (self.cell_mm / 1000.0) ** 2

    def to_world(self, points: Floats) -> Floats:
        """Return points in mm, (..., 2), x and y, of points in cells: columns and rows from the corner."""
        (cosine, sine), (across, up) = self._axes, np.moveaxis(points * self.cell_mm, -1, 0)
        return np.stack(
            [self.x_mm + cosine * across - sine * up, self.y_mm + sine * across + cosine * up], axis=-1
        )

    def to_cells(self, points: Floats) -> Floats:
        """Return points in cells, (..., 2), columns and rows from the corner, of points in mm, x and y."""
        (cosine, sine), (x, y) = self._axes, np.moveaxis(points - np.array([self.x_mm, self.y_mm]), -1, 0)
        return np.stack([cosine * x + sine * y, cosine * y - sine * x], axis=-1) / self.cell_mm

    @property
    def _axes(self) -> tuple[float, float]:
        """The cosine and the sine of the yaw; exact for multiples of a right angle."""
        if self.yaw_deg % 90.0 == 0.0:
            return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(self.yaw_deg // 90.0) % 4]
        return math.cos(math.radians(self.yaw_deg)), math.sin(math.radians(self.yaw_deg))
