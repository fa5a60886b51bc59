"""The scene for the present walls of a world, in which doors are open and elevator doors slide.

The world replaces the edge of an open door by other walls, which are identified by their places. A wall on
the line of an elevator's doors is one of their leaves, and carries the pictures on it. A wall from a door's
jamb away from the door is its leaf. All others belong to a room or a cabin.
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


def scene_with_walls(scene: Scene, walls: NDArray[np.float64]) -> Scene:
    """Return the scene for other walls, (n, 4) or more columns: x0, y0, x1, y1 in mm; none of length 0."""
    segments = np.ascontiguousarray(walls[:, :4])
    own = scene.walls[: scene.own]
    places = {tuple(row): wall for wall, row in enumerate(own[:, :4].tolist())}
    found = [places.get(tuple(row)) for row in segments.tolist()]
    standing = np.zeros(scene.own, dtype=np.int64)
    standing[[wall for wall in found if wall is not None]] = 1
    others = wall_table(segments[[wall is None for wall in found]])
    appearances = [_appearance(scene, row) for row in others]
    panels = [np.array(appearance.panels, dtype=np.float64).reshape(-1, 5) for appearance in appearances]
    wall_pictures = [
        np.array(appearance.wall_pictures, dtype=np.float64).reshape(-1, 6) for appearance in appearances
    ]
    return scene._replace(
        walls=np.ascontiguousarray(np.vstack([own, others])),
        standing=np.concatenate([standing, np.ones(len(others), dtype=np.int64)]),
        shades=np.concatenate([scene.shades[: scene.own], [appearance.shade for appearance in appearances]]),
        covers=np.concatenate(
            [
                scene.covers[: scene.own],
                np.array([appearance.cover for appearance in appearances], dtype=np.int64),
            ]
        ),
        panels=np.vstack([scene.panels[: scene.first[scene.own]], *panels]),
        first=_firsts(scene.first[: scene.own + 1], panels),
        wall_pictures=np.vstack([scene.wall_pictures[: scene.first_wall_picture[scene.own]], *wall_pictures]),
        first_wall_picture=_firsts(scene.first_wall_picture[: scene.own + 1], wall_pictures),
    )


def _firsts(first: Ints, added: list[Floats2]) -> Ints:
    counts = np.array([len(rows) for rows in added], dtype=np.int64)
    return np.concatenate([first, first[-1] + counts.cumsum()]).astype(np.int64)


_Rows = list[list[float]]


class _Appearance(NamedTuple):
    """The appearance of a wall that is not an edge of the map: its shade or cover, panels and pictures."""

    shade: float = WALL_SHADE
    cover: int = BARE
    panels: Sequence[list[float]] = ()
    wall_pictures: Sequence[list[float]] = ()


def _appearance(scene: Scene, row: NDArray[np.float64]) -> _Appearance:
    for elevator in scene.elevators.tolist():
        wall = scene.walls[elevator]
        span = _on_line(wall, row)
        if span is not None and span[1] > span[0]:
            return _leaf_of_elevator(scene, elevator, *span)
        middle, here = (wall[:2] + wall[2:4]) / 2, (row[:2] + row[2:4]) / 2
        if math.dist(middle, here) < _CABIN_MM:
            return _Appearance(shade=_CABIN_SHADE)
    for door in scene.doors.tolist():
        if _is_leaf(scene.walls[door], row):
            return _Appearance(panels=[[0.0, float(row[6]), 0.0, _DOOR_TOP_MM, _LEAF_SHADE]])
    return _Appearance(shade=_ROOM_SHADE, cover=scene.rooms)


def _on_line(wall: NDArray[np.float64], row: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the range along a wall that another wall covers, or None if it is not on the same line."""
    spans = []
    for x, y in ((row[0], row[1]), (row[2], row[3])):
        dx, dy = x - wall[0], y - wall[1]
        along, aside = dx * wall[4] + dy * wall[5], dy * wall[4] - dx * wall[5]
        if abs(aside) > _NEAR_MM or not -_NEAR_MM <= along <= wall[6] + _NEAR_MM:
            return None
        spans.append(float(along))
    return spans[0], spans[1]


def _is_leaf(door: NDArray[np.float64], row: NDArray[np.float64]) -> bool:
    """Return True if a wall begins or ends at a jamb of a door, and is not parallel to the door."""
    jambs = ((door[0], door[1]), (door[2], door[3]))
    ends = ((row[0], row[1]), (row[2], row[3]))
    hangs = any(math.dist(jamb, end) < _NEAR_MM for jamb in jambs for end in ends)
    return hangs and abs(row[4] * door[5] - row[5] * door[4]) > 1e-3


def _leaf_of_elevator(scene: Scene, elevator: int, start: float, end: float) -> _Appearance:
    """Return the appearance of a leaf that has slid, by as much as it is shorter than half the doors."""
    length = float(scene.walls[elevator, 6])
    moved = length / 2 - (end - start)
    is_left = start < _NEAR_MM and end < length - _NEAR_MM
    half = (0.0, length / 2) if is_left else (length / 2, length)
    shift = -moved if is_left else -length / 2
    panels = _slid(scene.panels[scene.first[elevator] : scene.first[elevator + 1]], half, shift, end - start)
    wall_pictures = _slid(
        scene.wall_pictures[scene.first_wall_picture[elevator] : scene.first_wall_picture[elevator + 1]],
        half,
        shift,
        end - start,
    )
    for row in wall_pictures:
        row[5] += shift
    return _Appearance(panels=panels, wall_pictures=wall_pictures)


def _slid(rows: NDArray[np.float64], half: tuple[float, float], shift: float, length: float) -> _Rows:
    """Return the parts of rectangles on one half of the doors, moved with the leaf."""
    slid = []
    for start, end, *rest in rows.tolist():
        low = max(max(start, half[0]) + shift, 0.0)
        high = min(min(end, half[1]) + shift, length)
        if low < high:
            slid.append([low, high, *rest])
    return slid
