"""A scene with a world's present walls: doors stand open, those of elevators slide.

A wall of the building that the world lacks was replaced by others, and their places identify them: on the
line of an elevator's doors they are its leaves, which take along what is pasted on them; from the jamb of a
door on, leading away from it, its leaf; all others belong to a room or a cabin.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.sim.cameras.surfaces import BARE, WALL_SHADE, Scene
from colony.sim.compiled import Floats2, Ints
from colony.sim.sensors.sonar import wall_table
from colony.sim.world.elevators import CABIN_DEPTH_MM

_NEAR_MM = 1.0
_DOOR_TOP_MM, _LEAF_SHADE = 2100.0, 0.48
_ROOM_SHADE, _CABIN_SHADE = 0.70, 0.55
_CABIN_MM = (
    CABIN_DEPTH_MM + 1.0
)  # from the middle of an elevator's doors to the middle of a wall of its cabin


def fitted(scene: Scene, walls: NDArray[np.float64]) -> Scene:
    """Fit the scene to other walls, (n, 4) or more columns: x0, y0, x1, y1 in mm; none without length."""
    segments = np.ascontiguousarray(walls[:, :4])
    own = scene.walls[: scene.own]
    places = {tuple(row): wall for wall, row in enumerate(own[:, :4].tolist())}
    found = [places.get(tuple(row)) for row in segments.tolist()]
    standing = np.zeros(scene.own, dtype=np.int64)
    standing[[wall for wall in found if wall is not None]] = 1
    others = wall_table(segments[[wall is None for wall in found]])
    looks = [_look(scene, row) for row in others]
    panels = [np.array(look.panels, dtype=np.float64).reshape(-1, 5) for look in looks]
    hung = [np.array(look.hung, dtype=np.float64).reshape(-1, 6) for look in looks]
    return scene._replace(
        walls=np.ascontiguousarray(np.vstack([own, others])),
        standing=np.concatenate([standing, np.ones(len(others), dtype=np.int64)]),
        shades=np.concatenate([scene.shades[: scene.own], [look.shade for look in looks]]),
        covers=np.concatenate(
            [scene.covers[: scene.own], np.array([look.cover for look in looks], dtype=np.int64)]
        ),
        panels=np.vstack([scene.panels[: scene.first[scene.own]], *panels]),
        first=_firsts(scene.first[: scene.own + 1], panels),
        hung=np.vstack([scene.hung[: scene.first_hung[scene.own]], *hung]),
        first_hung=_firsts(scene.first_hung[: scene.own + 1], hung),
    )


def _firsts(first: Ints, added: list[Floats2]) -> Ints:
    counts = np.array([len(rows) for rows in added], dtype=np.int64)
    return np.concatenate([first, first[-1] + counts.cumsum()]).astype(np.int64)


_Rows = list[list[float]]


class _Look(NamedTuple):
    """A wall that is not the building's own: its shade or cover, its panels and pictures as in a scene."""

    shade: float = WALL_SHADE
    cover: int = BARE
    panels: Sequence[list[float]] = ()
    hung: Sequence[list[float]] = ()


def _look(scene: Scene, row: NDArray[np.float64]) -> _Look:
    for elevator in scene.elevators.tolist():
        wall = scene.walls[elevator]
        span = _on_line(wall, row)
        if span is not None and span[1] > span[0]:
            return _leaf_of_elevator(scene, elevator, *span)
        middle, here = (wall[:2] + wall[2:4]) / 2, (row[:2] + row[2:4]) / 2
        if math.dist(middle, here) < _CABIN_MM:
            return _Look(shade=_CABIN_SHADE)
    for door in scene.doors.tolist():
        if _is_leaf(scene.walls[door], row):
            return _Look(panels=[[0.0, float(row[6]), 0.0, _DOOR_TOP_MM, _LEAF_SHADE]])
    return _Look(shade=_ROOM_SHADE, cover=scene.rooms)


def _on_line(wall: NDArray[np.float64], row: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the range along a wall where another one lies on it, or None if it does not."""
    spans = []
    for x, y in ((row[0], row[1]), (row[2], row[3])):
        dx, dy = x - wall[0], y - wall[1]
        along, aside = dx * wall[4] + dy * wall[5], dy * wall[4] - dx * wall[5]
        if abs(aside) > _NEAR_MM or not -_NEAR_MM <= along <= wall[6] + _NEAR_MM:
            return None
        spans.append(float(along))
    return spans[0], spans[1]


def _is_leaf(door: NDArray[np.float64], row: NDArray[np.float64]) -> bool:
    """Return True if a wall hangs at one of the jambs of a door, and is turned away from it."""
    jambs = ((door[0], door[1]), (door[2], door[3]))
    ends = ((row[0], row[1]), (row[2], row[3]))
    hangs = any(math.dist(jamb, end) < _NEAR_MM for jamb in jambs for end in ends)
    return hangs and abs(row[4] * door[5] - row[5] * door[4]) > 1e-3


def _leaf_of_elevator(scene: Scene, elevator: int, start: float, end: float) -> _Look:
    """Return the look of a leaf that has slid: it moved by what it is short of half the doors."""
    length = float(scene.walls[elevator, 6])
    moved = length / 2 - (end - start)
    is_left = start < _NEAR_MM and end < length - _NEAR_MM
    half = (0.0, length / 2) if is_left else (length / 2, length)
    shift = -moved if is_left else -length / 2
    panels = _slid(scene.panels[scene.first[elevator] : scene.first[elevator + 1]], half, shift, end - start)
    hung = _slid(
        scene.hung[scene.first_hung[elevator] : scene.first_hung[elevator + 1]], half, shift, end - start
    )
    for row in hung:
        row[5] += shift
    return _Look(panels=panels, hung=hung)


def _slid(rows: NDArray[np.float64], half: tuple[float, float], shift: float, length: float) -> _Rows:
    """Return the parts of rectangles that are on one half of the doors, where the leaf has taken them."""
    slid = []
    for start, end, *rest in rows.tolist():
        low = max(max(start, half[0]) + shift, 0.0)
        high = min(min(end, half[1]) + shift, length)
        if low < high:
            slid.append([low, high, *rest])
    return slid
