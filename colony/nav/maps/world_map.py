"""A simulated world's map: what the simulator needs of it, whatever the format of its file."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.grid.model import Grid, GridCell
from colony.nav.maps.grid.outlines import TooManySidesError, outlines
from colony.nav.maps.grid.places import ReachableRegions, clearance_mm, nearest_place
from colony.nav.maps.grid.reader import EAST_DEG, load_grid
from colony.nav.maps.source import is_grid, no_building
from colony.nav.maps.stickrep.geometry import corners, in_free_space
from colony.nav.maps.stickrep.model import Map, Pose
from colony.nav.maps.stickrep.reader import load_map
from colony.nav.maps.walls import walls_of
from colony.text.diagnostics import DiagnosticError, error
from colony.text.source import Source, Span

MAX_WALLS = 200_000

SMALL_SHARE = 0.1
"""Share of a grid's free cells below which a start is taken for one in a stray patch."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorldMap:
    """A world for robots: its walls, its holes, its docks and where to start.

    Attributes:
        name: the name of the map.
        walls: (n, 4) float64, read-only: x0, y0, x1, y1 in mm, x east and y north. The free space lies to the
            right of each.
        holes: the holes in the floor: polygons, (n, 2) in mm each.
        docks: the poses of robots that stand at charging docks.
        source: the content of the map's file, for whatever needs more, such as pictures.
        files: the paths of the files that it was read from, the map first; empty for a map in memory.
    """

    name: str
    walls: NDArray[np.float64]
    holes: tuple[NDArray[np.float64], ...] = ()
    docks: tuple[Pose, ...] = ()
    source: Map | Grid
    files: tuple[str, ...] = ()

    @property
    def has_outlines(self) -> bool:
        """True if the walls are outlines of solid things on their left, which nobody sees from there."""
        return isinstance(self.source, Grid)

    def start(self, radius_mm: float, wanted: tuple[float, float, float] | None = None) -> Pose:
        """Return the pose at which a robot of this radius starts.

        By default this is the start of a StickRep map. In a grid it is (0, 0), where its maker began, or the
        nearest place with enough room, facing along x. If the robot can get to less than a tenth of the free
        cells from there, it is the nearest place in the largest region.

        Args:
            radius_mm: the radius of the robot.
            wanted: x and y in mm and the heading in degrees, if another start is wanted. In a StickRep map,
                its distance from walls is left to the world.

        Raises:
            ValueError: the robot would stand in unknown space, outside the building or in one of its blocks,
                or there is no room for it.
        """
        match self.source:
            case Map():
                return self.source.start if wanted is None else _start_in_building(self.source, Pose(*wanted))
            case Grid():
                return _start_in_grid(self.source, self.walls, radius_mm, wanted)

    def reachable(self, radius_mm: float, start: Pose) -> float:
        """Return the share of the free cells that a robot can cover from its start, from 0 to 1.

        It is 1 in a StickRep map, which has no cells.
        """
        if isinstance(self.source, Map):
            return 1.0
        reach = _reach(self.source, radius_mm)
        return reach.share(reach.region(start.x_mm, start.y_mm))

    def remarks(self, radius_mm: float, start: Pose) -> tuple[str, ...]:
        """Return sentences, without a period, on what is unusual about the map or this start of a robot."""
        if isinstance(self.source, Map):
            return ()
        share = self.reachable(radius_mm, start)
        if share >= SMALL_SHARE:
            return self.source.remarks
        at = f"({start.x_mm / 1000:.2f} m, {start.y_mm / 1000:.2f} m)"
        stuck = f"a robot with a radius of {radius_mm:.0f} mm can get from {at} to {100 * share:.2g} %"
        return (*self.source.remarks, f"{stuck} of the free cells; --start X,Y,HEADING names another place")

    def is_known(self, x_mm: float, y_mm: float) -> bool:
        """Return False if a place is in unknown cells of a grid, or beyond its image."""
        return isinstance(self.source, Map) or self.source.state_at(x_mm, y_mm) is not GridCell.UNKNOWN

    def contains(self, x_mm: float, y_mm: float) -> bool:
        """Return False if a place is beyond the image of a grid."""
        return isinstance(self.source, Map) or self.source.contains(x_mm, y_mm)

    def building(self, purpose: str) -> Map:
        """Return the map of the building, for something that a grid has not.

        Raises:
            DiagnosticError: this is a grid; `purpose` begins the message.
        """
        match self.source:
            case Map():
                return self.source
            case Grid():
                raise DiagnosticError([no_building(self.files[0] if self.files else self.name, purpose)])


def world_of(source: Map, *files: str) -> WorldMap:
    """Return the world of a StickRep map: its doors and elevators are closed."""
    return WorldMap(
        name=source.name,
        walls=walls_of(source).segments,
        holes=tuple(np.array(hole.corners()) for hole in source.holes),
        docks=source.docks,
        source=source,
        files=files,
    )


def world_of_grid(grid: Grid, *files: str) -> WorldMap:
    """Return the world of an occupancy grid: the outlines of its occupied cells are its walls.

    Raises:
        DiagnosticError: there are too many walls.
    """
    try:
        cells = outlines(grid.cells == GridCell.OCCUPIED)
        if len(cells) > MAX_WALLS:
            raise TooManySidesError(f"the outlines have {len(cells):,} walls; expected at most {MAX_WALLS:,}")
    except TooManySidesError as problem:
        hint = "remove single occupied cells from the image, or give a coarser one"
        span = Span(Source(files[0] if files else grid.name, ""), 0, 0)
        raise DiagnosticError([error("M023", span, str(problem), hint)]) from None
    walls = grid.to_world(cells.reshape(-1, 2, 2)).reshape(-1, 4)
    walls.flags.writeable = False
    return WorldMap(name=grid.name, walls=walls, docks=grid.docks, source=grid, files=files)


def load_world(path: str | os.PathLike[str]) -> WorldMap:
    """Load the map at `path`.

    Raises:
        DiagnosticError: the file cannot be read, or is not a valid map; with all errors found, each with its
            location.
    """
    file = os.fspath(path)
    if not is_grid(path):
        return world_of(load_map(path), file)
    grid = load_grid(path)
    return world_of_grid(grid, file, grid.image)


def _start_in_building(building: Map, wanted: Pose) -> Pose:
    if not in_free_space(tuple(map(corners, building.rings)), wanted.x_mm, wanted.y_mm):
        found = f"({wanted.x_mm:.0f}, {wanted.y_mm:.0f}) is not in free space"
        raise ValueError(f"{found}; expected a place inside an outline and outside its blocks")
    return wanted


def _start_in_grid(
    grid: Grid, walls: NDArray[np.float64], radius_mm: float, wanted: tuple[float, float, float] | None
) -> Pose:
    x, y, heading = (0.0, 0.0, EAST_DEG) if wanted is None else wanted
    room = clearance_mm(grid, walls, x, y, radius_mm)
    if room < radius_mm and wanted is None:
        nearest = nearest_place(grid, radius_mm)
        if nearest is None:
            problem = f"there is no free place for a robot with a radius of {radius_mm:.0f} mm"
            raise ValueError("; ".join([problem, *grid.remarks]))
        x, y = nearest
    elif grid.state_at(x, y) is GridCell.OCCUPIED:
        raise ValueError(f"({x:.0f}, {y:.0f}) is in an occupied cell")
    elif room < radius_mm:
        found = f"({x:.0f}, {y:.0f}) is {room:.0f} mm from a wall or from cells that are unknown"
        raise ValueError(f"{found}; expected at least {radius_mm:.0f} mm")
    if wanted is None:
        x, y = _out_of_a_patch(grid, radius_mm, (x, y))
    return Pose(x, y, heading)


@lru_cache(maxsize=1)
def _reach(grid: Grid, radius_mm: float) -> ReachableRegions:
    return ReachableRegions(grid, radius_mm)


def _out_of_a_patch(grid: Grid, radius_mm: float, place: tuple[float, float]) -> tuple[float, float]:
    """Return a place, or one in the largest region if the robot can hardly get anywhere from there."""
    reach = _reach(grid, radius_mm)
    region = reach.region(*place)
    if region == reach.largest or reach.share(region) >= SMALL_SHARE:
        return place
    return nearest_place(grid, radius_mm, reach.cells(reach.largest)) or place
