"""What a building looks like: its walls with what is on them, the floor and the ceiling, in shades of gray.

A wall is painted in one shade and carries panels: rectangles of another shade, such as doors and skirting
boards. Whatever else is to be seen on walls later is more panels; what is to be seen on the ceiling belongs
to `colony.sim.camera`'s `_ceiling_shade`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from colony.nav.stickrep import EdgeKind, Map
from colony.nav.walls import walls_of
from colony.sim.compiled import Floats, Floats2, Ints
from colony.sim.sonar import wall_table

CEILING_MM = 2700.0

_WALL_SHADE = 0.78
_SKIRTING_MM, _SKIRTING_SHADE = 100.0, 0.35
_FRAME_MM, _FRAME_SHADE = 60.0, 0.30
_DOOR_MM = 2100.0
_LEAF_SHADES = {EdgeKind.DOOR: 0.48, EdgeKind.ELEVATOR: 0.62}


class Panel(NamedTuple):
    """A rectangle on wall `wall`, from `start` to `end` along it and `bottom` to `top` above the floor, all
    in mm. `shade` is from 0, black, to 1."""

    wall: int
    start: float
    end: float
    bottom: float
    top: float
    shade: float


class Scene(NamedTuple):
    """A building as the renderer takes it.

    Attributes:
        walls: (n, 7), as `wall_table` gives them.
        shades: (n,), from 0 to 1.
        panels: (m, 5), `Panel` without its wall, in the order of the walls; later ones lie on earlier ones.
        first: (n + 1,), where the panels of each wall begin.
        ceiling: its height in mm.
    """

    walls: Floats2
    shades: Floats
    panels: Floats2
    first: Ints
    ceiling: float


def scene_of(building: Map, *, ceiling_mm: float = CEILING_MM) -> Scene:
    """The scene of a map: doors and elevators have a leaf and a frame, walls a skirting board."""
    walls = walls_of(building)
    lengths = np.hypot(*(walls.segments[:, 2:] - walls.segments[:, :2]).T).tolist()
    panels = [
        panel
        for wall, (kind, length) in enumerate(zip(walls.kinds, lengths, strict=True))
        for panel in _panels(wall, kind, length)
    ]
    return scene(walls.segments, panels, ceiling_mm=ceiling_mm)


def scene(walls: ArrayLike, panels: Iterable[Panel] = (), *, ceiling_mm: float = CEILING_MM) -> Scene:
    """A scene of wall segments, (n, 4) in mm, and what is on them; segments without length are not seen."""
    segments = np.array(walls, dtype=np.float64).reshape(-1, 4)
    seen = np.flatnonzero(np.hypot(*(segments[:, 2:] - segments[:, :2]).T) > 0.0)
    places = {int(wall): place for place, wall in enumerate(seen)}
    ordered = sorted((p for p in panels if p.wall in places), key=lambda p: p.wall)
    counts = np.bincount([places[p.wall] for p in ordered], minlength=len(seen)).astype(np.int64)
    return Scene(
        walls=wall_table(segments[seen]),
        shades=np.full(len(seen), _WALL_SHADE),
        panels=np.array([p[1:] for p in ordered], dtype=np.float64).reshape(-1, 5),
        first=np.concatenate([[0], counts.cumsum()]).astype(np.int64),
        ceiling=float(ceiling_mm),
    )


def _panels(wall: int, kind: EdgeKind, length: float) -> Iterable[Panel]:
    if kind is EdgeKind.WALL:
        yield Panel(wall, 0.0, length, 0.0, _SKIRTING_MM, _SKIRTING_SHADE)
    else:
        yield Panel(wall, 0.0, length, 0.0, _DOOR_MM, _FRAME_SHADE)
        leaf = _LEAF_SHADES[kind]
        yield Panel(wall, _FRAME_MM, length - _FRAME_MM, 0.0, _DOOR_MM - _FRAME_MM, leaf)
