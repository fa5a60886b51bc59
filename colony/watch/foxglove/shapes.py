"""What Foxglove draws in 3D: poses, lines, scans and grids, in meters and radians.

Foxglove's axes are x ahead and y left, or x east and y north; angles count counterclockwise from x.
"""

from __future__ import annotations

import math
from base64 import b64encode
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from colony.ir.expression import DerivedValue, Slice, subexpressions
from colony.ir.program import Let, Limit, Program
from colony.ir.types import bearings_of
from colony.watch.scene import MapScene, SensorScene

Shape = dict[str, Any]

MAP, BASE = "map", "base"
"""The frames of reference: where the robot's position counts from, and the middle of the robot."""

MM_PER_M = 1000.0

Points = Iterable[tuple[float, float]]

_STRIP, _LOOP = 0, 1
_UINT8 = 1
_NO_TURN = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}

BLUE = {"r": 0.0, "g": 0.45, "b": 0.7, "a": 1.0}
GRAY = {"r": 0.5, "g": 0.5, "b": 0.5, "a": 0.6}
ORANGE = {"r": 0.9, "g": 0.6, "b": 0.0, "a": 1.0}


def time_of(t_ns: int) -> Shape:
    """Return a time, or a duration."""
    return {"sec": t_ns // 1_000_000_000, "nsec": t_ns % 1_000_000_000}


def vector(x: float, y: float) -> Shape:
    """Return a point on the floor."""
    return {"x": x, "y": y, "z": 0.0}


def turn(degrees: float) -> Shape:
    """Return a rotation about the vertical axis."""
    half = math.radians(degrees) / 2
    return {"x": 0.0, "y": 0.0, "z": math.sin(half), "w": math.cos(half)}


def pose_of(x_mm: float, y_mm: float, heading_deg: float) -> Shape:
    """Return a pose of the robot; heading 0 is north, which is +y."""
    return {"position": vector(x_mm / MM_PER_M, y_mm / MM_PER_M), "orientation": turn(heading_deg + 90)}


ORIGIN: Shape = {"position": vector(0.0, 0.0), "orientation": _NO_TURN}


def line(points: Points, color: Shape, *, closed: bool = False, width: float = 0.03) -> Shape:
    """Return a line through points in meters."""
    return {
        "type": _LOOP if closed else _STRIP,
        "pose": ORIGIN,
        "thickness": width,
        "scale_invariant": False,
        "points": [vector(x, y) for x, y in points],
        "color": color,
        "colors": [],
        "indices": [],
    }


def sphere(x: float, y: float, size: float, color: Shape) -> Shape:
    """Return a sphere on the floor, in meters."""
    pose = {"position": vector(x, y), "orientation": _NO_TURN}
    return {"pose": pose, "size": {"x": size, "y": size, "z": size}, "color": color}


def scene_update(
    t_ns: int, frame_id: str, name: str, lines: Sequence[Shape] = (), spheres: Sequence[Shape] = ()
) -> Shape:
    """Return the update that shows an entity until the next one of its name."""
    entity: Shape = {
        "timestamp": time_of(t_ns),
        "frame_id": frame_id,
        "id": name,
        "lifetime": time_of(0),
        "frame_locked": True,
        "spheres": list(spheres),
        "lines": list(lines),
    }
    others = ("metadata", "arrows", "cubes", "cylinders", "triangles", "texts", "models")
    return {"deletions": [], "entities": [entity | {other: [] for other in others}]}


# --- scans ---------------------------------------------------------------------------------------------

MAX_BEAMS = 4096
"""Maximum number of beams of a scan."""

EVEN_DEG = 0.01
"""Difference of angles up to which beams count as evenly spaced."""


class ScanShape:
    """An array with bearings as beams at equal angles; there may be beams without an element.

    Args:
        sensor: the sensor; its snapshots are in meters.
    """

    def __init__(self, sensor: SensorScene) -> None:
        self.sensor = sensor
        first, last = min(sensor.bearings), max(sensor.bearings)
        gaps = [b - a for a, b in pairwise(sorted(sensor.bearings))] or [1.0]
        step = sum(gaps) / len(gaps)
        if max(gaps) - min(gaps) > EVEN_DEG:
            thousandths = [round(1000 * gap) for gap in gaps]
            step = max(math.gcd(*thousandths) / 1000, (last - first) / (MAX_BEAMS - 1))
        self.beams = [round((angle - first) / step) for angle in sensor.bearings]
        self._is_plain = self.beams == list(range(len(self.beams)))
        self._head = {
            "frame_id": BASE,
            "pose": ORIGIN,
            "start_angle": math.radians(first),
            "end_angle": math.radians(last),
            "intensities": [],
        }

    def in_range(self, ranges: Sequence[float]) -> list[float]:
        """Return ranges in meters, with 0 where nothing is in range."""
        far = math.inf if self.sensor.high is None else self.sensor.high
        return [x if 0 <= x < far else 0.0 for x in ranges]

    def message(self, t_ns: int, ranges: Sequence[float]) -> Shape:
        """Return a scan; a beam without an element has the range 0."""
        if not self._is_plain:
            beams = [0.0] * (max(self.beams) + 1)
            for beam, x in zip(self.beams, ranges, strict=True):
                beams[beam] = x
            ranges = beams
        return {**self._head, "timestamp": time_of(t_ns), "ranges": ranges}


# --- zones ---------------------------------------------------------------------------------------------

MAX_CORNERS = 16
"""Corners of the arc of a zone, about."""


class Zone(NamedTuple):
    """The sector that a limit watches.

    Attributes:
        limit: the limit.
        angles: the bearings of the elements that it reads.
        watched: for each distance sensor of the program, the elements with these bearings.
    """

    limit: Limit
    angles: tuple[float, ...]
    watched: Mapping[str, tuple[int, ...]]

    def outline(self, ranges: Mapping[str, Sequence[float]]) -> list[tuple[float, float]]:
        """Return the corners of the sector, out to the nearest of the ranges, in meters; none without one."""
        seen = (ranges[name][i] for name, indices in self.watched.items() if name in ranges for i in indices)
        radius = min((x for x in seen if x > 0), default=0.0)
        every = max(1, len(self.angles) // MAX_CORNERS)
        corners = map(math.radians, dict.fromkeys((*self.angles[::every], self.angles[-1])))
        arc = [(round(radius * math.cos(a), 3), round(radius * math.sin(a), 3)) for a in corners]
        return [(0.0, 0.0), *arc] if radius else []


def zones_of(program: Program, scans: Sequence[SensorScene]) -> tuple[Zone, ...]:
    """Return the sectors that limits read, through the values that they are computed from."""
    lets = {d.name: d.expression for d in program.derived if isinstance(d, Let)}
    found: dict[tuple[str, int, str, tuple[float, ...]], Zone] = {}
    for limit in program.limits:
        for angles in _sectors(limit, lets):
            watched = {s.name: tuple(i for i, a in enumerate(s.bearings) if a in angles) for s in scans}
            key = (limit.actuator, limit.field_index, limit.relation, angles)
            found.setdefault(key, Zone(limit, angles, watched))
    return tuple(found.values())


def _sectors(limit: Limit, lets: Mapping[str, Any]) -> Iterator[tuple[float, ...]]:
    work, seen = [limit.bound, *([] if limit.condition is None else [limit.condition])], set[str]()
    while work:
        for node in subexpressions(work.pop()):
            if isinstance(node, DerivedValue) and node.name in lets and node.name not in seen:
                seen.add(node.name)
                work.append(lets[node.name])
            if isinstance(node, Slice) and (bearings := bearings_of(node.array.type)) is not None:
                yield tuple(bearings.angles[i] for i in node.indices)


# --- grid ----------------------------------------------------------------------------------------------

CELL_M = 0.05
"""Side of a cell of the map in meters, unless there would be more than `MAX_CELLS`."""

MAX_CELLS = 4_000_000


def grid_of(scene: MapScene, t_ns: int) -> Shape:
    """Return a map as a grid, in which cells of walls have the value 100 and all others 0."""
    xs = [x / MM_PER_M for wall in scene.walls for x in wall[::2]] or [0.0]
    ys = [y / MM_PER_M for wall in scene.walls for y in wall[1::2]] or [0.0]
    low_x, low_y, cell = min(xs), min(ys), CELL_M
    while (max(xs) - low_x + cell) * (max(ys) - low_y + cell) / cell**2 > MAX_CELLS:
        cell *= 2
    columns, rows = (int((high - low) / cell) + 1 for high, low in ((max(xs), low_x), (max(ys), low_y)))
    cells = bytearray(columns * rows)
    for x0, y0, x1, y1 in ([x / MM_PER_M for x in wall] for wall in scene.walls):
        steps = max(1, math.ceil(2 * math.hypot(x1 - x0, y1 - y0) / cell))
        for i in range(steps + 1):
            x, y = x0 + (x1 - x0) * i / steps - low_x, y0 + (y1 - y0) * i / steps - low_y
            cells[int(y / cell) * columns + int(x / cell)] = 100
    return {
        "timestamp": time_of(t_ns),
        "frame_id": MAP,
        "pose": {"position": vector(low_x, low_y), "orientation": _NO_TURN},
        "column_count": columns,
        "cell_size": {"x": cell, "y": cell},
        "row_stride": columns,
        "cell_stride": 1,
        "fields": [{"name": "wall", "offset": 0, "type": _UINT8}],
        "data": b64encode(cells).decode(),
    }
