"""Histogrammic in-motion mapping: a certainty grid built from sonar readings while the robot drives.

A reading adds 3 to the cell on the sonar's axis at the measured distance, and subtracts 1 from each cell on
the axis before it; certainties are 0 to 15. Real obstacles are hit repeatedly from different positions; false
ones decay. Source: Borenstein and Koren, Histogrammic In-Motion Mapping for Mobile Robot Obstacle
Avoidance (1991); thesis section 5.5.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.nav.pose.echoes import Floats, SonarModel, rome_sonars

MAX_CERTAINTY = 15
HIT_INCREMENT = 3
MISS_DECREMENT = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class HimmParameters:
    """The parameters of a local map; lengths in mm.

    Attributes:
        cell_mm: side of a cell.
        half_side_mm: distance of each side of the map from its origin.
        reach_mm: maximum distance of an echo that is marked, and of the cells that are cleared.
        sonars: the model of the sonars; a reading without an echo changes nothing.
    """

    cell_mm: float = 100.0
    half_side_mm: float = 16_000.0
    reach_mm: float = 3_000.0
    sonars: SonarModel = field(default_factory=rome_sonars)


class LocalPose(NamedTuple):
    """The pose of a robot in a local map.

    Millimeters ahead of and to the left of the map's origin, and the heading in radians, counterclockwise
    from the map's heading.
    """

    ahead_mm: float
    left_mm: float
    heading_rad: float


class Cells(NamedTuple):
    """Occupied cells, (n,) each: their centers in mm, ahead and to the left, and their certainties."""

    ahead_mm: Floats
    left_mm: Floats
    certainty: Floats


class HimmMap:
    """A square local map with its origin at the center. Mutable."""

    def __init__(self, parameters: HimmParameters | None = None) -> None:
        """Start with an empty map."""
        self.parameters = parameters or HimmParameters()
        side = 2 * round(self.parameters.half_side_mm / self.parameters.cell_mm)
        self._side = side
        self._bearings = self.parameters.sonars.bearings_rad()
        self._grid = np.zeros(side * side, dtype=np.int16)
        steps = int(self.parameters.reach_mm / self.parameters.cell_mm) + 2
        self._steps = np.arange(steps, dtype=np.float64)[None, :]

    @property
    def grid(self) -> NDArray[np.uint8]:
        """A copy of the certainties; row indices increase ahead, column indices to the left."""
        return self._grid.reshape(self._side, self._side).astype(np.uint8)

    def clear(self) -> None:
        """Clear all cells."""
        self._grid[:] = 0

    def mark(self, pose: LocalPose, ranges: Floats) -> None:
        """Add a scan, (sonars,) in mm; ignore invalid readings and cells outside the map."""
        parameters = self.parameters
        valid = np.flatnonzero((ranges >= 0.0) & (ranges < parameters.sonars.full_range_mm))
        angles = self._bearings[valid] + pose.heading_rad
        cosine, sine = np.cos(angles), np.sin(angles)
        ring_mm = parameters.sonars.ring_mm
        origin = (pose.ahead_mm + ring_mm * cosine, pose.left_mm + ring_mm * sine)
        distance = ranges[valid]
        hit = distance <= parameters.reach_mm
        cleared = np.minimum(distance, parameters.reach_mm)
        row, column = self._cell_of(origin[0] + distance * cosine, origin[1] + distance * sine)
        self._decrement(origin, cosine, sine, cleared, row, column, hit)
        self._increment(row[hit], column[hit])

    def cells(self, min_certainty: int = HIT_INCREMENT) -> Cells:
        """Return the cells with a certainty of `min_certainty` or more."""
        indices = np.flatnonzero(self._grid >= min_certainty)
        row, column = np.divmod(indices, self._side)
        half, cell = self._side // 2, self.parameters.cell_mm
        return Cells(
            ahead_mm=(row - half + 0.5) * cell,
            left_mm=(column - half + 0.5) * cell,
            certainty=self._grid[indices].astype(np.float64),
        )

    def _cell_of(self, ahead: Floats, left: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        cell, half = self.parameters.cell_mm, self._side // 2
        return (
            np.floor(ahead / cell).astype(np.int64) + half,
            np.floor(left / cell).astype(np.int64) + half,
        )

    def _decrement(
        self,
        origin: tuple[Floats, Floats],
        cosine: Floats,
        sine: Floats,
        distance: Floats,
        row: NDArray[np.int64],
        column: NDArray[np.int64],
        hit: NDArray[np.bool_],
    ) -> None:
        """Decrement each cell before the echo once, but not the cell of the echo."""
        # Each step moves one cell in the axis' dominant direction, so that no cell is visited twice.
        step = self.parameters.cell_mm / np.maximum(np.abs(cosine), np.abs(sine))[:, None]
        along = self._steps * step
        rows, columns = self._cell_of(
            origin[0][:, None] + along * cosine[:, None], origin[1][:, None] + along * sine[:, None]
        )
        free = (along < distance[:, None]) & self._inside(rows, columns)
        free &= (rows != row[:, None]) | (columns != column[:, None]) | ~hit[:, None]
        np.subtract.at(self._grid, (rows * self._side + columns)[free], MISS_DECREMENT)
        np.maximum(self._grid, 0, out=self._grid)

    def _increment(self, row: NDArray[np.int64], column: NDArray[np.int64]) -> None:
        """Increment the cells that were hit."""
        inside = (row > 0) & (row < self._side - 1) & (column > 0) & (column < self._side - 1)
        indices = (row * self._side + column)[inside]
        np.add.at(self._grid, indices, HIT_INCREMENT)
        self._grid[indices] = np.minimum(self._grid[indices], MAX_CERTAINTY)

    def _inside(self, row: NDArray[np.int64], column: NDArray[np.int64]) -> NDArray[np.bool_]:
        return (row >= 0) & (row < self._side) & (column >= 0) & (column < self._side)
