"""The surfaces of a building: walls with everything on them, floor and ceiling, in shades of gray.

A wall has a material, such as painted blocks, or a uniform shade. On it are panels, rectangles of another
shade such as doors and skirting boards, and on top of them pictures: plates, markers, posters. `scene.py`
puts them on the edges of a map, and `fitting.py` removes or moves them while doors are open.
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
"""Material of a wall with a uniform shade."""


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


EVEN_LIGHTING = Lighting(levels=np.ones((1, 1)), x=0.0, y=0.0, cell=1.0)
"""Uniform light."""


class Scene(NamedTuple):
    """A building in the renderer's form.

    Attributes:
        walls: (n, 7), from `wall_table`.
        present: (n,), 1 if the wall is present, 0 if an open door has replaced it.
        shades: (n,), from 0 to 1.
        materials: (n,), the index in `atlas` of each wall's material, or `BARE`.
        panels: (m, 5), `Panel` without its wall, in the order of the walls; later ones hide earlier ones.
        first_panel: (n + 1,), start of the panels of each wall.
        wall_pictures: (k, 6), `WallPicture` without its wall, in the order of the walls.
        first_wall_picture: (n + 1,), start of the pictures of each wall.
        atlas: the pictures; the first ones are people.
        lighting: the light levels.
        ceiling: height of the ceiling in mm.
        doors, elevators: the indices of the walls that are doors or elevators, which may open.
        room_material: the material of the walls of rooms behind open doors, or `BARE`.
        map_wall_count: number of walls of the map; the walls after them come from open doors.
    """

    walls: Floats2
    present: Ints
    shades: Floats
    materials: Ints
    panels: Floats2
    first_panel: Ints
    wall_pictures: Floats2
    first_wall_picture: Ints
    atlas: Atlas
    lighting: Lighting
    ceiling: float
    doors: Ints
    elevators: Ints
    room_material: int
    map_wall_count: int


def scene(
    walls: ArrayLike,
    panels: Iterable[Panel] = (),
    *,
    ceiling_mm: float = CEILING_MM,
    materials: Sequence[int] | None = None,
    wall_pictures: Iterable[WallPicture] = (),
    atlas: Atlas | None = None,
    lighting: Lighting = EVEN_LIGHTING,
    doors: Sequence[int] = (),
    elevators: Sequence[int] = (),
    room_material: int = BARE,
) -> Scene:
    """Return a scene of wall segments, (n, 4) in mm, and everything on them; empty segments are invisible.

    Args:
        walls: the segments.
        panels: the panels on them.
        ceiling_mm: height of the ceiling.
        materials: index of each wall's material in `atlas`; by default all walls are bare.
        wall_pictures: the pictures on the walls.
        atlas: the atlas, from `atlas_with`.
        lighting: the light levels.
        doors: the indices of the walls that are doors, which may open.
        elevators: the indices of the walls that are elevator doors, which may open.
        room_material: the material of the walls of rooms behind doors.
    """
    segments = np.array(walls, dtype=np.float64).reshape(-1, 4)
    visible = np.flatnonzero(np.hypot(*(segments[:, 2:] - segments[:, :2]).T) > 0.0)
    indices = {int(wall): index for index, wall in enumerate(visible)}
    panel_rows, first_panel = _sorted_by_wall(
        ((indices[panel.wall], panel[1:]) for panel in panels if panel.wall in indices), len(visible)
    )
    picture_rows, first_wall_picture = _sorted_by_wall(
        ((indices[picture.wall], picture[1:]) for picture in wall_pictures if picture.wall in indices),
        len(visible),
    )
    material_indices = (
        np.full(len(segments), BARE) if materials is None else np.array(materials, dtype=np.int64)
    )
    return Scene(
        walls=wall_table(segments[visible]),
        present=np.ones(len(visible), dtype=np.int64),
        shades=np.full(len(visible), WALL_SHADE),
        materials=material_indices[visible],
        panels=panel_rows.reshape(-1, 5),
        first_panel=first_panel,
        wall_pictures=picture_rows.reshape(-1, 6),
        first_wall_picture=first_wall_picture,
        atlas=atlas_with(()) if atlas is None else atlas,
        lighting=lighting,
        ceiling=float(ceiling_mm),
        doors=_index_array(indices[door] for door in doors if door in indices),
        elevators=_index_array(indices[elevator] for elevator in elevators if elevator in indices),
        room_material=room_material,
        map_wall_count=len(visible),
    )


def atlas_with(pictures: Sequence[Picture]) -> Atlas:
    """Return an atlas of people and of `pictures`, whose indices begin at `PEOPLE`."""
    return atlas_of((*people(), *pictures))


PEOPLE = len(people())
"""Number of pictures of people with which an atlas begins."""


def _index_array(indices: Iterable[int]) -> Ints:
    return np.array(list(indices), dtype=np.int64)


def _sorted_by_wall(rows: Iterable[tuple[int, tuple[float, ...]]], walls: int) -> tuple[Floats2, Ints]:
    """Return rows sorted by the index of their wall, and the start of each wall's rows."""
    ordered = sorted(rows, key=lambda row: row[0])
    counts = np.bincount(np.array([wall for wall, _ in ordered], dtype=np.int64), minlength=walls)
    first = np.concatenate([[0], counts.cumsum()]).astype(np.int64)
    return np.array([row for _, row in ordered], dtype=np.float64), first
