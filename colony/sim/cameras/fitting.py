"""The scene for the current walls of a world, in which doors are open and elevator doors slide.

The world replaces the edge of an open door by other walls, which are recognized by their positions. A wall on
the line of an elevator's doors is one of their leaves, and carries the pictures on it. A wall from a door's
jamb away from the door is a leaf of that door. All others belong to a room or a cabin.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.sim.cameras.surfaces import BARE, WALL_SHADE, RenderedScene
from colony.sim.compiled import Floats2, Ints
from colony.sim.sensors.sonar import wall_table
from colony.sim.world.elevators import CABIN_DEPTH_MM

_NEAR_MM = 1.0
_DOOR_TOP_MM, _LEAF_SHADE = 2100.0, 0.48
_ROOM_SHADE, _CABIN_SHADE = 0.70, 0.55
_CABIN_MM = CABIN_DEPTH_MM + 1.0
"""Maximum distance from the center of an elevator's doors to the center of a wall of its cabin."""


def scene_with_walls(scene: RenderedScene, walls: NDArray[np.float64]) -> RenderedScene:
    """Return the scene with its walls replaced by others, none of length 0.

    `walls` is (n, 4) or wider: x0, y0, x1, y1 in mm.
    """
    segments = np.ascontiguousarray(walls[:, :4])
    count = scene.map_wall_count
    map_walls = scene.walls[:count]
    index_of = {tuple(row): wall for wall, row in enumerate(map_walls[:, :4].tolist())}
    indices = [index_of.get(tuple(row)) for row in segments.tolist()]
    present = np.zeros(count, dtype=np.int64)
    present[[wall for wall in indices if wall is not None]] = 1
    others = wall_table(segments[[wall is None for wall in indices]])
    appearances = [_appearance(scene, row) for row in others]
    panels = [np.array(appearance.panels, dtype=np.float64).reshape(-1, 5) for appearance in appearances]
    wall_pictures = [
        np.array(appearance.wall_pictures, dtype=np.float64).reshape(-1, 6) for appearance in appearances
    ]
    return scene._replace(
        walls=np.ascontiguousarray(np.vstack([map_walls, others])),
        present=np.concatenate([present, np.ones(len(others), dtype=np.int64)]),
        shades=np.concatenate([scene.shades[:count], [appearance.shade for appearance in appearances]]),
        materials=np.concatenate(
            [
                scene.materials[:count],
                np.array([appearance.material for appearance in appearances], dtype=np.int64),
            ]
        ),
        panels=np.vstack([scene.panels[: scene.first_panel[count]], *panels]),
        first_panel=_offsets(scene.first_panel[: count + 1], panels),
        wall_pictures=np.vstack([scene.wall_pictures[: scene.first_wall_picture[count]], *wall_pictures]),
        first_wall_picture=_offsets(scene.first_wall_picture[: count + 1], wall_pictures),
    )


def _offsets(first: Ints, added: list[Floats2]) -> Ints:
    counts = np.array([len(rows) for rows in added], dtype=np.int64)
    return np.concatenate([first, first[-1] + counts.cumsum()]).astype(np.int64)


_Rows = list[list[float]]


class _Appearance(NamedTuple):
    """The appearance of a wall that is not an edge of the map: its shade or material, panels and pictures."""

    shade: float = WALL_SHADE
    material: int = BARE
    panels: Sequence[list[float]] = ()
    wall_pictures: Sequence[list[float]] = ()


def _appearance(scene: RenderedScene, row: NDArray[np.float64]) -> _Appearance:
    for elevator in scene.elevators.tolist():
        wall = scene.walls[elevator]
        span = _collinear_span(wall, row)
        if span is not None and span[1] > span[0]:
            return _leaf_of_elevator(scene, elevator, *span)
        door_center, center = (wall[:2] + wall[2:4]) / 2, (row[:2] + row[2:4]) / 2
        if math.dist(door_center, center) < _CABIN_MM:
            return _Appearance(shade=_CABIN_SHADE)
    for door in scene.doors.tolist():
        if _is_leaf(scene.walls[door], row):
            return _Appearance(panels=[[0.0, float(row[6]), 0.0, _DOOR_TOP_MM, _LEAF_SHADE]])
    return _Appearance(shade=_ROOM_SHADE, material=scene.room_material)


def _collinear_span(wall: NDArray[np.float64], row: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the span of another wall along a wall, or None if they are not on the same line."""
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
    is_hinged = any(math.dist(jamb, end) < _NEAR_MM for jamb in jambs for end in ends)
    return is_hinged and abs(row[4] * door[5] - row[5] * door[4]) > 1e-3


def _leaf_of_elevator(scene: RenderedScene, elevator: int, start: float, end: float) -> _Appearance:
    """Return the appearance of an elevator's leaf, which is visible from `start` to `end` of the doors."""
    length = float(scene.walls[elevator, 6])
    slid = length / 2 - (end - start)
    is_left = start < _NEAR_MM and end < length - _NEAR_MM
    half = (0.0, length / 2) if is_left else (length / 2, length)
    shift = -slid if is_left else -length / 2
    panels = _slide(
        scene.panels[scene.first_panel[elevator] : scene.first_panel[elevator + 1]], half, shift, end - start
    )
    wall_pictures = _slide(
        scene.wall_pictures[scene.first_wall_picture[elevator] : scene.first_wall_picture[elevator + 1]],
        half,
        shift,
        end - start,
    )
    for row in wall_pictures:
        row[5] += shift
    return _Appearance(panels=panels, wall_pictures=wall_pictures)


def _slide(rows: NDArray[np.float64], half: tuple[float, float], shift: float, length: float) -> _Rows:
    """Return the parts of rectangles on one half of the doors, moved with the leaf."""
    slid = []
    for start, end, *rest in rows.tolist():
        low = max(max(start, half[0]) + shift, 0.0)
        high = min(min(end, half[1]) + shift, length)
        if low < high:
            slid.append([low, high, *rest])
    return slid
