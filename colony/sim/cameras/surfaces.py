"""The surfaces of a building: walls with everything on them, floor and ceiling, in shades of gray.

A wall has a cover, such as painted blocks, or one shade. On it are panels, rectangles of another shade such
as doors and skirting boards, and on top of them pictures: plates, markers, posters. `scene.py` puts them on
the edges of a map, and `fitting.py` removes or moves them while doors are open.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from colony.sim.cameras.atlas import Atlas, Picture, atlas_of
from colony.sim.cameras.silhouettes import people
from colony.sim.compiled import Floats, Floats2, Ints
from colony.sim.sensors.sonar import wall_table

CEILING_MM = 2700.0
WALL_SHADE = 0.78
BARE = -1
"""Cover of a wall that has one shade only."""


class Panel(NamedTuple):
    """A rectangle on wall `wall`, from `start` to `end` along it and from `bottom` to `top` in height.

    Lengths are in mm, heights above the floor. `shade` is from 0 (black) to 1.
    """

    wall: int
    start: float
    end: float
    bottom: float
    top: float
    shade: float


class WallPicture(NamedTuple):
    """A picture on wall `wall`, from `start` to `end` along it and from `bottom` to `top` in height.

    This is the visible part; the whole picture begins at `origin` along the wall and reaches up to `top`.
    """

    wall: int
    start: float
    end: float
    bottom: float
    top: float
    picture: int
    origin: float


class Lighting(NamedTuple):
    """The light levels of a building at the corners of a grid, by columns; 1 is normal.

    The first corner is at (x, y); the corners are `cell` mm apart.
    """

    levels: Floats2
    x: float
    y: float
    cell: float


EVEN = Lighting(levels=np.ones((1, 1)), x=0.0, y=0.0, cell=1.0)
"""Uniform light."""


class Scene(NamedTuple):
    """A building in the renderer's form.

    Attributes:
        walls: (n, 7), from `wall_table`.
        standing: (n,), 1 if the wall is present, 0 if an open door has replaced it.
        shades: (n,), from 0 to 1.
        covers: (n,), the number of the picture that covers a wall, or `BARE`.
        panels: (m, 5), `Panel` without its wall, in the order of the walls; later ones cover earlier ones.
        first: (n + 1,), start of the panels of each wall.
        wall_pictures: (k, 6), `WallPicture` without its wall, likewise.
        first_wall_picture: (n + 1,), start of the pictures of each wall.
        atlas: the pictures; the first ones are people.
        lighting: the light levels.
        ceiling: height of the ceiling in mm.
        doors, elevators: the numbers of the walls that are doors or elevators, which may open.
        rooms: the cover of the walls of rooms behind open doors, or `BARE`.
        own: number of walls of the map; the walls after them come from open doors.
    """

    walls: Floats2
    standing: Ints
    shades: Floats
    covers: Ints
    panels: Floats2
    first: Ints
    wall_pictures: Floats2
    first_wall_picture: Ints
    atlas: Atlas
    lighting: Lighting
    ceiling: float
    doors: Ints
    elevators: Ints
    rooms: int
    own: int


def scene(
    walls: ArrayLike,
    panels: Iterable[Panel] = (),
    *,
    ceiling_mm: float = CEILING_MM,
    covers: Sequence[int] | None = None,
    wall_pictures: Iterable[WallPicture] = (),
    atlas: Atlas | None = None,
    lighting: Lighting = EVEN,
    doors: Sequence[int] = (),
    elevators: Sequence[int] = (),
    rooms: int = BARE,
) -> Scene:
    """Return a scene of wall segments, (n, 4) in mm, and everything on them; empty segments are invisible.

    Args:
        walls: the segments.
        panels: the panels on them.
        ceiling_mm: height of the ceiling.
        covers: number of each wall's cover in `atlas`; by default all walls are bare.
        wall_pictures: the pictures on the walls.
        atlas: the atlas, from `atlas_with`.
        lighting: the light levels.
        doors: the numbers of the walls that are doors, which may open.
        elevators: the numbers of the walls that are elevator doors, which may open.
        rooms: the cover of the walls of rooms behind doors.
    """
    segments = np.array(walls, dtype=np.float64).reshape(-1, 4)
    visible = np.flatnonzero(np.hypot(*(segments[:, 2:] - segments[:, :2]).T) > 0.0)
    places = {int(wall): place for place, wall in enumerate(visible)}
    panel_rows, first = _by_wall(((places[p.wall], p[1:]) for p in panels if p.wall in places), len(visible))
    picture_rows, first_wall_picture = _by_wall(
        ((places[h.wall], h[1:]) for h in wall_pictures if h.wall in places), len(visible)
    )
    covering = np.full(len(segments), BARE) if covers is None else np.array(covers, dtype=np.int64)
    return Scene(
        walls=wall_table(segments[visible]),
        standing=np.ones(len(visible), dtype=np.int64),
        shades=np.full(len(visible), WALL_SHADE),
        covers=covering[visible],
        panels=panel_rows.reshape(-1, 5),
        first=first,
        wall_pictures=picture_rows.reshape(-1, 6),
        first_wall_picture=first_wall_picture,
        atlas=atlas_with(()) if atlas is None else atlas,
        lighting=lighting,
        ceiling=float(ceiling_mm),
        doors=_numbers(places[door] for door in doors if door in places),
        elevators=_numbers(places[elevator] for elevator in elevators if elevator in places),
        rooms=rooms,
        own=len(visible),
    )


def atlas_with(pictures: Sequence[Picture]) -> Atlas:
    """Return an atlas of people and of pictures, whose numbers begin at `PEOPLE`."""
    return atlas_of((*people(), *pictures))


PEOPLE = len(people())
"""Number of pictures of people with which an atlas begins."""


def _numbers(found: Iterable[int]) -> Ints:
    return np.array(list(found), dtype=np.int64)


def _by_wall(things: Iterable[tuple[int, tuple[float, ...]]], walls: int) -> tuple[Floats2, Ints]:
    """Return things sorted by the number of their wall, and the start of each wall's things."""
    ordered = sorted(things, key=lambda thing: thing[0])
    counts = np.bincount(np.array([wall for wall, _ in ordered], dtype=np.int64), minlength=walls)
    first = np.concatenate([[0], counts.cumsum()]).astype(np.int64)
    return np.array([thing for _, thing in ordered], dtype=np.float64), first
