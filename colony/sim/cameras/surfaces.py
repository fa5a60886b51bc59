"""The looks of a building: its walls with what is on them, the floor and the ceiling, in shades of gray.

A wall has a cover, such as painted blocks, or one shade; on it lie panels, rectangles of another shade such
as doors and skirting boards, and on those hang pictures: plates, markers, posters. `scene.py` says
what is on the edges of a map, and `fitting.py` what of it is left while doors stand open.
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
"""Number in place of a cover's: the wall has one shade."""


class Panel(NamedTuple):
    """A rectangle on wall `wall`, from `start` to `end` along it and from `bottom` to `top` in height.

    All in mm, heights above the floor. `shade` is from 0, black, to 1.
    """

    wall: int
    start: float
    end: float
    bottom: float
    top: float
    shade: float


class Hung(NamedTuple):
    """A picture on wall `wall`: the part from `start` to `end` along it and from `bottom` to `top` in height.

    Heights are above the floor. The whole picture begins at `origin` along the wall and reaches up to `top`.
    """

    wall: int
    start: float
    end: float
    bottom: float
    top: float
    picture: int
    origin: float


class Lighting(NamedTuple):
    """The light levels of a building, at the corners of a grid, by columns; 1 is usual.

    The first corner of the grid is at (x, y); the corners are `cell` mm apart.
    """

    levels: Floats2
    x: float
    y: float
    cell: float


EVEN = Lighting(levels=np.ones((1, 1)), x=0.0, y=0.0, cell=1.0)
"""The same light everywhere."""


class Scene(NamedTuple):
    """A building as the renderer takes it.

    Attributes:
        walls: (n, 7), as `wall_table` gives them.
        standing: (n,), 1 where a wall is there, 0 where it has made way for an open door.
        shades: (n,), from 0 to 1.
        covers: (n,), the number of the picture that covers a wall, or `BARE`.
        panels: (m, 5), `Panel` without its wall, in the order of the walls; later ones lie on earlier ones.
        first: (n + 1,), where the panels of each wall begin.
        hung: (k, 6), `Hung` likewise.
        first_hung: (n + 1,), where those of each wall begin.
        atlas: the pictures; the first ones are people.
        lighting: the light levels.
        ceiling: its height in mm.
        doors, elevators: the numbers of walls that are doors or elevators, and may open.
        rooms: the cover of the walls of rooms that are seen through open doors, or `BARE`.
        own: number of walls of the building itself; those after them came with doors that are open.
    """

    walls: Floats2
    standing: Ints
    shades: Floats
    covers: Ints
    panels: Floats2
    first: Ints
    hung: Floats2
    first_hung: Ints
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
    hung: Iterable[Hung] = (),
    atlas: Atlas | None = None,
    lighting: Lighting = EVEN,
    doors: Sequence[int] = (),
    elevators: Sequence[int] = (),
    rooms: int = BARE,
) -> Scene:
    """Return a scene of wall segments, (n, 4) in mm, and what is on them; empty segments are not visible.

    Args:
        walls: the segments.
        panels: the panels on them.
        ceiling_mm: height of the ceiling.
        covers: number of each wall's cover in `atlas`; by default all walls are bare.
        hung: the pictures on the walls.
        atlas: as `atlas_with` gives it.
        lighting: the light levels.
        doors: the numbers of walls that are doors, which may open.
        elevators: the numbers of walls that are elevators' doors, which may open.
        rooms: the cover of what is behind the doors.
    """
    segments = np.array(walls, dtype=np.float64).reshape(-1, 4)
    seen = np.flatnonzero(np.hypot(*(segments[:, 2:] - segments[:, :2]).T) > 0.0)
    places = {int(wall): place for place, wall in enumerate(seen)}
    painted, first = _by_wall(((places[p.wall], p[1:]) for p in panels if p.wall in places), len(seen))
    pasted, first_hung = _by_wall(((places[h.wall], h[1:]) for h in hung if h.wall in places), len(seen))
    covering = np.full(len(segments), BARE) if covers is None else np.array(covers, dtype=np.int64)
    return Scene(
        walls=wall_table(segments[seen]),
        standing=np.ones(len(seen), dtype=np.int64),
        shades=np.full(len(seen), WALL_SHADE),
        covers=covering[seen],
        panels=painted.reshape(-1, 5),
        first=first,
        hung=pasted.reshape(-1, 6),
        first_hung=first_hung,
        atlas=atlas_with(()) if atlas is None else atlas,
        lighting=lighting,
        ceiling=float(ceiling_mm),
        doors=_numbers(places[door] for door in doors if door in places),
        elevators=_numbers(places[elevator] for elevator in elevators if elevator in places),
        rooms=rooms,
        own=len(seen),
    )


def atlas_with(pictures: Sequence[Picture]) -> Atlas:
    """Return an atlas of people, for every building, and of pictures, whose numbers begin at `PEOPLE`."""
    return atlas_of((*people(), *pictures))


PEOPLE = len(people())
"""Number of pictures of people with which an atlas begins."""


def _numbers(found: Iterable[int]) -> Ints:
    return np.array(list(found), dtype=np.int64)


def _by_wall(things: Iterable[tuple[int, tuple[float, ...]]], walls: int) -> tuple[Floats2, Ints]:
    """Return things, each with its wall's number, sorted by that, and where each wall's things begin."""
    ordered = sorted(things, key=lambda thing: thing[0])
    counts = np.bincount(np.array([wall for wall, _ in ordered], dtype=np.int64), minlength=walls)
    first = np.concatenate([[0], counts.cumsum()]).astype(np.int64)
    return np.array([thing for _, thing in ordered], dtype=np.float64), first
