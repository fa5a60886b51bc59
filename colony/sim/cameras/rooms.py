"""The rooms behind the doors of a map, as far as they are visible through an open door.

A map ends at its doors. The simulator adds a room behind each, three meters deep and slightly wider than the
door, or smaller if another wall of the map leaves less space, so that rooms never overlap corridors. A wide
door has two leaves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.stickrep.geometry import Point
from colony.nav.maps.walls import free_distance

DEPTH_MM = 3000.0

_ASIDE_MM = 500.0  # largest extent of a room beside its door
_WALL_THICKNESS_MM = 150.0
_TWO_LEAVES_MM = 1400.0  # wider doors have two leaves
_PROBE_START_MM = 20.0  # depth behind the door at which free distances are first measured


@dataclass(frozen=True, slots=True, kw_only=True)
class Room:
    """The room behind a door that runs from (x0_mm, y0_mm) to (x1_mm, y1_mm), with the room to its left.

    `before_mm` and `after_mm` are the extents of the room beyond the start and the end of the door.
    """

    x0_mm: float
    y0_mm: float
    x1_mm: float
    y1_mm: float
    depth_mm: float
    before_mm: float
    after_mm: float


def room_behind(walls: NDArray[np.float64], door: int) -> Room | None:
    """Return the room behind a door, among walls (n, 4) in mm, or None if the door cannot open."""
    x0, y0, x1, y1 = walls[door].tolist()
    width = math.hypot(x1 - x0, y1 - y0)
    ex, ey = (x1 - x0) / width, (y1 - y0) / width
    nx, ny = -ey, ex
    others = np.delete(walls, door, axis=0)

    def free_mm(along: float, deep: float, ux: float, uy: float) -> float:
        start = Point(x0 + along * ex + deep * nx, y0 + along * ey + deep * ny)
        return free_distance(others, start, Point(ux, uy), 0.0) - _WALL_THICKNESS_MM

    columns = np.linspace(-_ASIDE_MM, width + _ASIDE_MM, 9).tolist()
    depth = min(DEPTH_MM, *(free_mm(along, _PROBE_START_MM, nx, ny) for along in columns))
    if depth < _leaf_mm(width) + _WALL_THICKNESS_MM:
        return None
    rows = (_PROBE_START_MM, depth / 2, depth)
    before = min(_ASIDE_MM, *(free_mm(0.0, deep, -ex, -ey) for deep in rows))
    after = min(_ASIDE_MM, *(free_mm(width, deep, ex, ey) for deep in rows))
    return Room(
        x0_mm=x0, y0_mm=y0, x1_mm=x1, y1_mm=y1,
        depth_mm=depth, before_mm=max(before, 0.0), after_mm=max(after, 0.0),
    )  # fmt: skip


def open_door_segments(
    room: Room, angle_deg: float, hinge_first: bool
) -> list[tuple[float, float, float, float]]:
    """Return the segments that replace an open door: the walls of the room, then one leaf or two.

    A single leaf hangs at the start of the door if `hinge_first` is True, else at its end.
    """
    width = math.hypot(room.x1_mm - room.x0_mm, room.y1_mm - room.y0_mm)
    ex, ey = (room.x1_mm - room.x0_mm) / width, (room.y1_mm - room.y0_mm) / width

    def to_world(along: float, deep: float) -> tuple[float, float]:
        return room.x0_mm + along * ex - deep * ey, room.y0_mm + along * ey + deep * ex

    corners = [
        (0.0, 0.0), (-room.before_mm, 0.0), (-room.before_mm, room.depth_mm),
        (width + room.after_mm, room.depth_mm), (width + room.after_mm, 0.0), (width, 0.0),
    ]  # fmt: skip
    segments = [(*to_world(*start), *to_world(*end)) for start, end in pairwise(corners) if start != end]
    leaf = _leaf_mm(width)
    across, deep = leaf * math.cos(math.radians(angle_deg)), leaf * math.sin(math.radians(angle_deg))
    if leaf < width or hinge_first:
        segments.append((*to_world(0.0, 0.0), *to_world(across, deep)))
    if leaf < width or not hinge_first:
        segments.append((*to_world(width - across, deep), *to_world(width, 0.0)))
    return segments


def _leaf_mm(width: float) -> float:
    return width / 2 if width > _TWO_LEAVES_MM else width
