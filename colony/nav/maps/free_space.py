"""The free space of a world's map: where something round can move, and random ways through it.

    space = FreeSpace(world_map)
    here, there = space.random_leg((start.x_mm, start.y_mm), 300.0, rng)

A leg is straight. Whatever legs lead to from a free place is free, too, and can be reached from there: so
random places are found by legs, in maps of any format.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.grid.model import Grid
from colony.nav.maps.grid.places import cells_with_room, labeled
from colony.nav.maps.world_map import WorldMap

Place = tuple[float, float]
"""x and y in mm."""

_TRIES = 150
_LENGTHS_MM = (
    (1_500.0, 12_000.0),
    (300.0, 1_500.0),
)  # of legs: short ones are tried where there is no long one
_BESIDE_MM = 1_500.0
_THIN_MM = 1.0  # the radius of a disk that passes wherever there is no wall
_RASTER_MM = 100.0  # cells of a map that is no grid
_LEGS = 12  # legs from a place to a random one


class NoRoomError(ValueError):
    """A map has no free place that is large enough."""


class FreeSpace:
    """The free space of a map, without its holes. Stateful: keeps what it computed of a grid.

    In a grid, a place is free if the cells around it are, with a margin of one to two cells.

    Args:
        world_map: the map.
    """

    def __init__(self, world_map: WorldMap) -> None:
        self._grid = world_map.source if isinstance(world_map.source, Grid) else None
        edges = [np.hstack([hole, np.roll(hole, -1, axis=0)]) for hole in world_map.holes]
        self._walls = np.vstack([world_map.walls, *edges])
        self._with_room = lru_cache(maxsize=8)(cells_with_room)
        self._reached = lru_cache(maxsize=8)(self._places)

    def is_free(self, start: Place, end: Place, radius_mm: float) -> bool:
        """Return True if a disk of this radius can move straight from `start` to `end`."""
        if self._grid is None:
            return bool((_distances(self._walls, start, end) >= radius_mm).all())
        mask = self._with_room(self._grid, radius_mm)
        count = 2 + math.ceil(2.0 * math.dist(start, end) / self._grid.cell_mm)
        cells = np.floor(self._grid.to_cells(np.linspace(start, end, count))).astype(np.int64)
        inside = ((cells >= 0) & (cells < mask.shape[::-1])).all()
        return bool(inside and mask[cells[:, 1], cells[:, 0]].all())

    def random_leg(self, start: Place, radius_mm: float, rng: np.random.Generator) -> tuple[Place, Place]:
        """Return the two ends of a random free leg for a disk, which can reach them from `start`.

        Where `start` is too near to a wall for the disk, it begins at a place beside it.

        Raises:
            NoRoomError: it cannot leave `start`.
        """
        begin = self._beside(start, radius_mm, rng)
        leg = (begin, begin)
        for _ in range(_LEGS):
            end = self._random_end(leg[1], radius_mm, rng)
            leg = leg[::-1] if end is None else (leg[1], end)
        if leg[0] == leg[1]:
            raise _no_room(start, radius_mm)
        return leg

    def random_place(self, start: Place, radius_mm: float, rng: np.random.Generator) -> Place:
        """Return a random free place for a disk, which can reach it from `start`; all are equally probable.

        Raises:
            NoRoomError: it cannot leave `start`.
        """
        places = self._reached(start, radius_mm)
        if not len(places):
            raise _no_room(start, radius_mm)
        x, y = places[rng.integers(len(places))].tolist()
        return x, y

    def _places(self, start: Place, radius_mm: float) -> NDArray[np.float64]:
        """Return the centers, (n, 2), of the cells of a raster that a disk can reach from a place."""
        if self._grid is not None:
            mask = self._with_room(self._grid, radius_mm)
            rows, columns = np.indices(mask.shape, dtype=np.float64)
            centers = self._grid.to_world(np.stack([columns, rows], axis=-1) + 0.5)
        else:
            corners = self._walls.reshape(-1, 2)
            low, high = corners.min(axis=0), corners.max(axis=0)
            x, y = (np.arange(a, b, _RASTER_MM) for a, b in zip(low, high, strict=True))
            centers = np.stack(np.meshgrid(x, y), axis=-1)
            mask = self._free_centers(centers, low, radius_mm)
        regions, gaps = labeled(mask), np.linalg.norm(centers - np.array(start), axis=-1)
        gaps[~mask] = np.inf
        found: NDArray[np.float64] = centers[(regions == regions.flat[gaps.argmin()]) & mask]
        return found

    def _free_centers(
        self, centers: NDArray[np.float64], low: NDArray[np.float64], radius_mm: float
    ) -> NDArray[np.bool_]:
        """Return a mask of centers, (rows, columns, 2), that have room; `low` is the first one."""
        mask = np.ones(centers.shape[:2], dtype=bool)
        for wall in self._walls:
            ends = wall.reshape(2, 2)
            first = np.maximum((ends.min(axis=0) - radius_mm - low) // _RASTER_MM, 0.0).astype(int)
            last = ((ends.max(axis=0) + radius_mm - low) // _RASTER_MM).astype(int) + 2
            near = np.s_[first[1] : last[1], first[0] : last[0]]
            mask[near] &= _from_segment(centers[near], *ends) >= radius_mm
        return mask

    def _beside(self, start: Place, radius_mm: float, rng: np.random.Generator) -> Place:
        """Return a place within `_BESIDE_MM` where a disk fits, if it is found; `start` itself if it fits."""
        if self.is_free(start, start, radius_mm):
            return start
        for dx, dy in rng.uniform(-_BESIDE_MM, _BESIDE_MM, (_TRIES, 2)).tolist():
            place = (start[0] + dx, start[1] + dy)
            if self.is_free(place, place, radius_mm) and self.is_free(start, place, _THIN_MM):
                return place
        return start

    def _random_end(self, start: Place, radius_mm: float, rng: np.random.Generator) -> Place | None:
        """Return the end of a free leg that begins at a place; None if none is found."""
        for shortest, longest in _LENGTHS_MM:
            for heading, length in rng.uniform((0.0, shortest), (math.tau, longest), (_TRIES, 2)).tolist():
                end = (start[0] - length * math.sin(heading), start[1] + length * math.cos(heading))
                if self.is_free(start, end, radius_mm):
                    return end
        return None


def _no_room(start: Place, radius_mm: float) -> NoRoomError:
    at = f"({start[0]:.0f}, {start[1]:.0f})"
    return NoRoomError(f"nothing with a radius of {radius_mm:.0f} mm can move away from {at}")


def _distances(walls: NDArray[np.float64], start: Place, end: Place) -> NDArray[np.float64]:
    """Return the distance of each wall, (n, 4), from the segment between two places; 0 where they cross."""
    a, b = np.array(start), np.array(end)
    p, q = walls[:, :2], walls[:, 2:]
    nearest = np.minimum(
        np.minimum(_from_segment(a, p, q), _from_segment(b, p, q)),
        np.minimum(_from_segment(p, a, b), _from_segment(q, a, b)),
    )
    sides = _side(a, b, p) * _side(a, b, q) < 0.0
    crossed = sides & (_side(p, q, a) * _side(p, q, b) < 0.0)
    return np.where(crossed, 0.0, nearest)


def _from_segment(
    point: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]
) -> NDArray[np.float64]:
    along, offset = end - start, point - start
    squared = np.maximum((along * along).sum(axis=-1), 1e-12)
    fraction = np.clip((offset * along).sum(axis=-1) / squared, 0.0, 1.0)
    gap: NDArray[np.float64] = np.linalg.norm(offset - fraction[..., None] * along, axis=-1)
    return gap


def _side(
    start: NDArray[np.float64], end: NDArray[np.float64], point: NDArray[np.float64]
) -> NDArray[np.float64]:
    along, offset = np.moveaxis(end - start, -1, 0), np.moveaxis(point - start, -1, 0)
    found: NDArray[np.float64] = along[0] * offset[1] - along[1] * offset[0]
    return found
