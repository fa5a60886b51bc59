"""Histogrammic in-motion mapping: a certainty grid built from sonar readings while the robot drives.

A reading adds 3 to the cell on the sonar's axis at the measured distance, and subtracts 1 from each cell on
the axis before it; certainties are 0 to 15. Real obstacles are hit repeatedly from different places; false
ones wear off. Source: Borenstein and Koren, Histogrammic In-Motion Mapping for Mobile Robot Obstacle
Avoidance (1991); thesis section 5.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.nav.pose.echoes import BEARINGS_RAD, Floats

MAX_CERTAINTY = 15
HIT_INCREMENT = 3
MISS_DECREMENT = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class HimmParameters:
    """The parameters of a local map; lengths in mm.

    Attributes:
        cell_mm: the side of a cell.
        half_side_mm: distance of each side of the map from its origin.
        reach_mm: largest distance of an echo that is marked, and of the cells that are cleared.
        full_range_mm: reading of a sonar without an echo; it changes nothing.
        ring_mm: distance from the robot's center to each transducer.
    """

    cell_mm: float = 100.0
    half_side_mm: float = 16_000.0
    reach_mm: float = 3_000.0
    full_range_mm: float = 10_000.0
    ring_mm: float = 360.0


class LocalPose(NamedTuple):
    """The pose of a robot in a local map.

    Millimeters ahead of and to the left of the map's origin, and the heading in radians, counterclockwise
    from the map's heading.
    """

    ahead_mm: float
    left_mm: float
    heading_rad: float


class Cells(NamedTuple):
    """Occupied cells, (n,) each: their middles in mm, ahead and to the left, and their certainties."""

    ahead_mm: Floats
    left_mm: Floats
    certainty: Floats


class HimmMap:
    """A square local map with its origin in the middle. Mutable."""

    def __init__(self, parameters: HimmParameters | None = None) -> None:
        """Start with an empty map."""
        self.parameters = parameters or HimmParameters()
        side = 2 * round(self.parameters.half_side_mm / self.parameters.cell_mm)
        self._side = side
        self._grid = np.zeros(side * side, dtype=np.int16)
        steps = int(self.parameters.reach_mm / self.parameters.cell_mm) + 2
        self._steps = np.arange(steps, dtype=np.float64)[None, :]

    @property
    def grid(self) -> NDArray[np.uint8]:
        """A copy of the certainties, (rows, columns); rows count ahead, columns to the left."""
        return self._grid.reshape(self._side, self._side).astype(np.uint8)

    def clear(self) -> None:
        """Clear all cells."""
        self._grid[:] = 0

    def mark(self, pose: LocalPose, ranges: Floats) -> None:
        """Add a scan, (24,) in mm; ignore invalid readings, and cells outside of the map."""
        parameters = self.parameters
        valid = np.flatnonzero((ranges >= 0.0) & (ranges < parameters.full_range_mm))
        angles = BEARINGS_RAD[valid] + pose.heading_rad
        cosine, sine = np.cos(angles), np.sin(angles)
        first = (pose.ahead_mm + parameters.ring_mm * cosine, pose.left_mm + parameters.ring_mm * sine)
        way = ranges[valid]
        close = way <= parameters.reach_mm
        reached = np.minimum(way, parameters.reach_mm)
        row, column = self._cell_of(first[0] + way * cosine, first[1] + way * sine)
        self._lower(first, cosine, sine, reached, row, column, close)
        self._raise(row[close], column[close])

    def cells(self, least: int = HIT_INCREMENT) -> Cells:
        """Return the cells with a certainty of `least` or more."""
        at = np.flatnonzero(self._grid >= least)
        row, column = np.divmod(at, self._side)
        half, cell = self._side // 2, self.parameters.cell_mm
        return Cells(
            ahead_mm=(row - half + 0.5) * cell,
            left_mm=(column - half + 0.5) * cell,
            certainty=self._grid[at].astype(np.float64),
        )

    def _cell_of(self, ahead: Floats, left: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        cell, half = self.parameters.cell_mm, self._side // 2
        return (
            np.floor(ahead / cell).astype(np.int64) + half,
            np.floor(left / cell).astype(np.int64) + half,
        )

    def _lower(
        self,
        first: tuple[Floats, Floats],
        cosine: Floats,
        sine: Floats,
        way: Floats,
        row: NDArray[np.int64],
        column: NDArray[np.int64],
        marked: NDArray[np.bool_],
    ) -> None:
        """Lower the cells on each axis, once each, but not the marked one."""
        # A step is one cell along the axis' main direction, so that no cell is visited twice.
        step = self.parameters.cell_mm / np.maximum(np.abs(cosine), np.abs(sine))[:, None]
        along = self._steps * step
        rows, columns = self._cell_of(
            first[0][:, None] + along * cosine[:, None], first[1][:, None] + along * sine[:, None]
        )
        free = (along < way[:, None]) & self._inside(rows, columns)
        free &= (rows != row[:, None]) | (columns != column[:, None]) | ~marked[:, None]
        np.subtract.at(self._grid, (rows * self._side + columns)[free], MISS_DECREMENT)
        np.maximum(self._grid, 0, out=self._grid)

    def _raise(self, row: NDArray[np.int64], column: NDArray[np.int64]) -> None:
        """Raise the cells that were hit."""
        inside = (row > 0) & (row < self._side - 1) & (column > 0) & (column < self._side - 1)
        at = (row * self._side + column)[inside]
        np.add.at(self._grid, at, HIT_INCREMENT)
        self._grid[at] = np.minimum(self._grid[at], MAX_CERTAINTY)

    def _inside(self, row: NDArray[np.int64], column: NDArray[np.int64]) -> NDArray[np.bool_]:
        return (row >= 0) & (row < self._side) & (column >= 0) & (column < self._side)
