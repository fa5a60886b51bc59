"""Histogrammic in-motion mapping: a grid of certainties made from sonar readings while the robot drives.

A reading adds 3 to the cell on the axis of the sonar at the measured distance, and takes 1 from each cell on
the axis before it; certainties are 0 to 15. What is really there is hit again and again from other places,
what is not is worn down. Source: Borenstein and Koren, Histogrammic In-Motion Mapping for Mobile Robot
Obstacle Avoidance (1991); thesis section 5.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.nav.pose.echoes import BEARINGS_RAD, Floats

MOST = 15
RISE = 3
FALL = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class HimmSetting:
    """The setting of a local map; lengths in mm.

    Attributes:
        cell_mm: the side of a cell.
        half_side_mm: the map reaches so far from its origin, ahead, back and to both sides.
        reach_mm: echoes from beyond are not marked, the axis is cleared only so far.
        full_range_mm: a reading this long says that nothing was heard; it changes nothing.
        ring_mm: from the robot's center to each transducer.
    """

    cell_mm: float = 100.0
    half_side_mm: float = 16_000.0
    reach_mm: float = 3_000.0
    full_range_mm: float = 10_000.0
    ring_mm: float = 360.0


class LocalPose(NamedTuple):
    """The pose of a robot in a local map.

    Millimeters ahead of the place where the map began and to the left of it, and the heading in radians,
    counterclockwise from the heading there.
    """

    ahead_mm: float
    left_mm: float
    heading_rad: float


class Cells(NamedTuple):
    """Occupied cells: (n,) each, the middle of each in mm, ahead and to the left, and its certainty."""

    ahead_mm: Floats
    left_mm: Floats
    certainty: Floats


class HimmMap:
    """A local map, square, its origin in the middle. Mutable."""

    def __init__(self, setting: HimmSetting | None = None) -> None:
        """Begin with an empty map."""
        self.setting = setting or HimmSetting()
        side = 2 * round(self.setting.half_side_mm / self.setting.cell_mm)
        self._side = side
        self._grid = np.zeros(side * side, dtype=np.int16)
        steps = int(self.setting.reach_mm / self.setting.cell_mm) + 2
        self._steps = np.arange(steps, dtype=np.float64)[None, :]

    @property
    def grid(self) -> NDArray[np.uint8]:
        """The certainties: (rows, columns), a copy; rows count ahead, columns to the left."""
        return self._grid.reshape(self._side, self._side).astype(np.uint8)

    def clear(self) -> None:
        """Clear all cells."""
        self._grid[:] = 0

    def mark(self, pose: LocalPose, ranges: Floats) -> None:
        """Take in a scan: (24,) in mm. Whatever lies outside of the map is left out, and what is no range."""
        setting = self.setting
        heard = np.flatnonzero((ranges >= 0.0) & (ranges < setting.full_range_mm))
        angles = BEARINGS_RAD[heard] + pose.heading_rad
        cosine, sine = np.cos(angles), np.sin(angles)
        first = (pose.ahead_mm + setting.ring_mm * cosine, pose.left_mm + setting.ring_mm * sine)
        way = ranges[heard]
        close = way <= setting.reach_mm
        reached = np.minimum(way, setting.reach_mm)
        row, column = self._cell_of(first[0] + way * cosine, first[1] + way * sine)
        self._lower(first, cosine, sine, reached, row, column, close)
        self._raise(row[close], column[close])

    def cells(self, least: int = RISE) -> Cells:
        """Return the cells whose certainty is at least so much."""
        at = np.flatnonzero(self._grid >= least)
        row, column = np.divmod(at, self._side)
        half, cell = self._side // 2, self.setting.cell_mm
        return Cells(
            ahead_mm=(row - half + 0.5) * cell,
            left_mm=(column - half + 0.5) * cell,
            certainty=self._grid[at].astype(np.float64),
        )

    def _cell_of(self, ahead: Floats, left: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        cell, half = self.setting.cell_mm, self._side // 2
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
        """Take from the cells on each axis, once each; not from the one that is marked."""
        # One step goes on by one cell in the axis' main direction, so that no cell is met twice.
        step = self.setting.cell_mm / np.maximum(np.abs(cosine), np.abs(sine))[:, None]
        along = self._steps * step
        rows, columns = self._cell_of(
            first[0][:, None] + along * cosine[:, None], first[1][:, None] + along * sine[:, None]
        )
        free = (along < way[:, None]) & self._inside(rows, columns)
        free &= (rows != row[:, None]) | (columns != column[:, None]) | ~marked[:, None]
        np.subtract.at(self._grid, (rows * self._side + columns)[free], FALL)
        np.maximum(self._grid, 0, out=self._grid)

    def _raise(self, row: NDArray[np.int64], column: NDArray[np.int64]) -> None:
        """Add to the cells that were hit."""
        inside = (row > 0) & (row < self._side - 1) & (column > 0) & (column < self._side - 1)
        at = (row * self._side + column)[inside]
        np.add.at(self._grid, at, RISE)
        self._grid[at] = np.minimum(self._grid[at], MOST)

    def _inside(self, row: NDArray[np.int64], column: NDArray[np.int64]) -> NDArray[np.bool_]:
        return (row >= 0) & (row < self._side) & (column >= 0) & (column < self._side)
