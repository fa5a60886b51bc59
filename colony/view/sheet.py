"""What pictures of worlds have in common: the sheet and its scale, the legend, the paths of robots."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.patches import Polygon
from matplotlib.textpath import TextPath
from numpy.typing import NDArray

from colony.nav.maps.stickrep.geometry import Point, corners
from colony.nav.maps.stickrep.model import EdgeKind, Map, Pose
from colony.nav.maps.walls import walls_of

# --- palette ------------------------------------------------------------------------------------------
#
# The colors of all pictures.

INK, MUTED, FAINT, PAPER, FLOOR = "#2b2f36", "#7a8290", "#d3d7de", "#eceef1", "#ffffff"
SERIES = ("#1769d6", "#0f9d76", "#c2335f", "#5d6b00", "#8a3fb8", "#00879e")
"""Colors of things of one kind: paths, enumerators."""
GOOD, BAD = SERIES[0], SERIES[2]


# --- map names ----------------------------------------------------------------------------------------
#
# Label placement for the picture of a map: names of corners, doors and elevators, behind their walls.
#
# Every name has a few candidate positions, the best first. It takes the first at which it touches no wall or
# other name, and is left out if there is none. Names are placed in order of importance: elevators, doors,
# then corners.

FONT_POINTS = 8.0
_GAP_POINTS = 3.0
_SHIFTS = ((6.0, 0.0), (6.0, 7.0), (6.0, -7.0), (17.0, 0.0), (17.0, 8.0), (17.0, -8.0))
"""Offsets of a name behind its wall and along it, in points; the best first."""
_LINE_HEIGHT = 1.25  # in font sizes
_MIN_AXIS_COMPONENT = 0.98  # of the unit normal of a wall that counts as parallel to an axis

Rank = Literal["elevator", "door", "corner"]
_RANKS: tuple[Rank, ...] = ("elevator", "door", "corner")
WEIGHTS: dict[Rank, str] = {"elevator": "bold", "door": "normal", "corner": "bold"}
"""Font weights by rank."""


class Box(NamedTuple):
    """An axis-parallel rectangle, in mm."""

    low_x: float
    low_y: float
    high_x: float
    high_y: float

    def touches(self, other: Box) -> bool:
        """Return True if the two boxes have a point in common."""
        return (
            self.low_x <= other.high_x
            and other.low_x <= self.high_x
            and self.low_y <= other.high_y
            and other.low_y <= self.high_y
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedName:
    """A placed name.

    Attributes:
        text: the name.
        rank: the kind of element that it names.
        center: the center of the text.
        upright: True if the text reads upward.
        box: the area that the text covers.
    """

    text: str
    rank: Rank
    center: Point
    upright: bool
    box: Box


@dataclass(frozen=True, slots=True, kw_only=True)
class _NameRequest:
    """A name to be placed: `anchor` is its door or corner, `out` the direction away from the floor."""

    text: str
    rank: Rank
    anchor: Point
    out: Point
    line: tuple[int, int]  # ring and side, so that names on one wall have the same orientation


def place_names(map_: Map, mm_per_point: float) -> tuple[PlacedName, ...]:
    """Place the names of a map's doors, elevators and corners where there is space.

    Args:
        map_: the map.
        mm_per_point: millimeters of the building per typographical point.
    """
    walls = walls_of(map_).segments
    requests = sorted(_requests(map_), key=lambda r: _RANKS.index(r.rank))
    upright_lines = _crowded_lines(requests, mm_per_point)
    placed_boxes: list[Box] = []
    placed: list[PlacedName] = []
    for request in requests:
        for upright, center, box in _candidates(request, request.line in upright_lines, mm_per_point):
            if not any(box.touches(other) for other in placed_boxes) and not _overlaps_wall(box, walls):
                placed_boxes.append(box)
                placed.append(
                    PlacedName(text=request.text, rank=request.rank, center=center, upright=upright, box=box)
                )
                break
    return tuple(placed)


def _requests(map_: Map) -> Iterator[_NameRequest]:
    elevator_files = {elevator.node: elevator.file for elevator in reversed(map_.elevators)}
    for i, ring in enumerate(map_.rings):
        nodes, side = corners(ring), 0
        for j, (node, edge) in enumerate(zip(ring.nodes, ring.edges, strict=True)):
            here, there, last = nodes[j], nodes[(j + 1) % len(nodes)], nodes[j - 1]
            after, before = _left_of(here, there), _left_of(last, here)
            side += node.turn_deg != 0.0
            if node.corner:
                out = Point(after.x + before.x, after.y + before.y)
                yield _NameRequest(text=node.name, rank="corner", anchor=here, out=out, line=(i, side))
            if edge.kind is not EdgeKind.WALL:
                center = Point((here.x + there.x) / 2, (here.y + there.y) / 2)
                text = _without_side(node.name)
                if node.name in elevator_files:
                    text += f" ↕ {elevator_files[node.name].rpartition('/')[2].removesuffix('.stickrep')}"
                rank: Rank = "elevator" if edge.kind is EdgeKind.ELEVATOR else "door"
                yield _NameRequest(text=text, rank=rank, anchor=center, out=after, line=(i, side))


def _without_side(name: str) -> str:
    """Return a door's name from that of its left jamb: `101L` gives `101`, `NE.men.L` gives `NE.men`."""
    return name[:-1].removesuffix(".") if len(name.rstrip("L.")) > 0 and name[-1] == "L" else name


def _left_of(here: Point, there: Point) -> Point:
    """Return the unit vector to the back of a wall, which is on its left as traced."""
    length = math.hypot(there.x - here.x, there.y - here.y)
    return Point(-(there.y - here.y) / length, (there.x - here.x) / length)


def _crowded_lines(requests: Sequence[_NameRequest], mm_per_point: float) -> set[tuple[int, int]]:
    """Return the east-west walls on which the names of the doors do not fit side by side."""
    crowded = set()
    requests_by_line: dict[tuple[int, int], list[_NameRequest]] = {}
    for request in requests:
        if request.rank != "corner" and abs(request.out.y) > _MIN_AXIS_COMPONENT:
            requests_by_line.setdefault(request.line, []).append(request)
    for line, names in requests_by_line.items():
        names.sort(key=lambda r: r.anchor.x)
        for left, right in pairwise(names):
            min_distance = (_width(left.text, left.rank) + _width(right.text, right.rank)) / 2 + _GAP_POINTS
            if right.anchor.x - left.anchor.x < min_distance * mm_per_point:
                crowded.add(line)
    return crowded


@lru_cache(maxsize=1024)
def _width(text: str, rank: Rank) -> float:
    """Return the width of a name in the picture's font, in points."""
    font = FontProperties(weight=WEIGHTS[rank])
    return float(TextPath((0, 0), text, size=FONT_POINTS, prop=font).get_extents().width)


def _candidates(
    request: _NameRequest, prefer_upright: bool, mm_per_point: float
) -> Iterator[tuple[bool, Point, Box]]:
    """Yield the candidate positions of a name: True if upright, the text's center, and its area."""
    width, height = _width(request.text, request.rank), _LINE_HEIGHT * FONT_POINTS
    length = math.hypot(request.out.x, request.out.y) or 1.0
    out = Point(request.out.x / length, request.out.y / length)
    horizontal = abs(out.y) > _MIN_AXIS_COMPONENT and request.rank != "corner"
    for upright in (prefer_upright, not prefer_upright) if horizontal else (False,):
        wide, high = (height, width) if upright else (width, height)
        for gap, aside in _SHIFTS:
            shift_x = (gap + wide / 2) * out.x + aside * out.y
            shift_y = (gap + high / 2) * out.y - aside * out.x
            x = request.anchor.x + shift_x * mm_per_point
            y = request.anchor.y + shift_y * mm_per_point
            half_x, half_y = (0.5 * mm_per_point * (side + _GAP_POINTS) for side in (wide, high))
            yield upright, Point(x, y), Box(x - half_x, y - half_y, x + half_x, y + half_y)


def _overlaps_wall(box: Box, walls: NDArray[np.float64]) -> bool:
    """Return True if a box touches one of the wall segments, (n, 4) in mm."""
    low_x, high_x = np.minimum(walls[:, 0], walls[:, 2]), np.maximum(walls[:, 0], walls[:, 2])
    low_y, high_y = np.minimum(walls[:, 1], walls[:, 3]), np.maximum(walls[:, 1], walls[:, 3])
    candidates = (low_x <= box.high_x) & (high_x >= box.low_x) & (low_y <= box.high_y) & (high_y >= box.low_y)
    across_x, across_y = (
        walls[candidates, 2] - walls[candidates, 0],
        walls[candidates, 3] - walls[candidates, 1],
    )
    if not candidates.any():
        return False
    sides = [
        across_x * (y - walls[candidates, 1]) - across_y * (x - walls[candidates, 0])
        for x in (box.low_x, box.high_x)
        for y in (box.low_y, box.high_y)
    ]
    return bool(((np.min(sides, axis=0) <= 0.0) & (np.max(sides, axis=0) >= 0.0)).any())


# --- sheet --------------------------------------------------------------------------------------------

_MIN_INCHES, _MAX_INCHES = 11.0, 24.0
_MM_PER_INCH = 6_500.0  # pictures of large buildings are larger, so that names are legible
_MARGIN_POINTS = 16.0
_TITLE_POINTS, _STRIP_POINTS = 40.0, 28.0
_LEGEND_MARK_POINTS, _LETTER_POINTS = 38.0, 4.6  # maximum widths, in the legend
_SCALE_DIVISOR = 6.0
_DPI = 150
_PERSON = "#a33b6a"

DOCK = "#3f8f3a"
"""The color of docks."""


def new_figure() -> tuple[Figure, Axes]:
    """Return an empty figure, and its axes, which fill it."""
    figure = Figure(dpi=_DPI, facecolor=PAPER)
    return figure, figure.add_axes((0.0, 0.0, 1.0, 1.0))


def mm_per_point(width_mm: float, height_mm: float) -> float:
    """Return the scale of a picture of something of this size."""
    long_side = max(width_mm, height_mm)
    return long_side / (72.0 * min(max(_MIN_INCHES, long_side / _MM_PER_INCH), _MAX_INCHES))


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """The scale of a picture, and the bounding box of what it shows, in mm."""

    low_x: float
    low_y: float
    high_x: float
    high_y: float
    mm_per_point: float

    @property
    def width_points(self) -> float:
        """Width of what is shown."""
        return (self.high_x - self.low_x) / self.mm_per_point

    def above(self, points: float) -> float:
        """Return the y coordinate that is `points` above what is shown."""
        return self.high_y + points * self.mm_per_point

    def below(self, points: float) -> float:
        """Return the y coordinate that is `points` below what is shown."""
        return self.low_y - points * self.mm_per_point


def draw_paths(axes: Axes, paths: Sequence[NDArray[np.float64]], names: Sequence[str]) -> None:
    """Draw the paths of robots, each (n, 2) or (n, 3), and name them in the legend."""
    for i, path in enumerate(paths):
        name = names[i] if i < len(names) else ("robot" if len(paths) == 1 else f"robot {i}")
        name += " (○ start, ■ end)" if i == 0 else ""
        label = name if i < len(SERIES) else "_"
        _draw_path(axes, path, SERIES[i % len(SERIES)], label)


def draw_people(axes: Axes, people: Sequence[NDArray[np.float64]]) -> None:
    """Draw the paths of people, each (n, 2), below those of robots, with a dot where each ends."""
    if people:
        axes.add_collection(LineCollection(list(people), colors=_PERSON, linewidths=0.8, zorder=3.5))
        ends = np.array([path[-1] for path in people])
        axes.plot(ends[:, 0], ends[:, 1], "o", color=_PERSON, markersize=4, label="people", zorder=3.6)


def finish(figure: Figure, axes: Axes, sheet: Sheet, title: str) -> None:
    """Draw the title, the scale and the legend, and set the size of the figure."""
    _draw_scale(axes, sheet)
    axes.text(
        sheet.low_x, sheet.above(_TITLE_POINTS / 2), title, fontsize=13, color=INK, weight="bold", va="center"
    )
    _fit(figure, axes, sheet, _draw_legend(axes, sheet))


def _draw_legend(axes: Axes, sheet: Sheet) -> float:
    """Draw the legend, beside the scale bar if it fits there, otherwise in rows below it.

    Returns:
        Height needed below the building and its names, in points.
    """
    labels = axes.get_legend_handles_labels()[1]
    widths = [_LEGEND_MARK_POINTS + _LETTER_POINTS * len(label) for label in labels]
    fits_beside = sum(widths) < sheet.width_points * (1.0 - 1.0 / _SCALE_DIVISOR) - 50.0
    columns = len(labels) if fits_beside else max(1, min(4, int(sheet.width_points / max(widths))))
    axes.legend(
        loc="center right" if fits_beside else "upper left", ncols=columns,
        bbox_to_anchor=(sheet.high_x, sheet.below(_STRIP_POINTS / 2))
        if fits_beside else (sheet.low_x, sheet.below(_STRIP_POINTS)),
        bbox_transform=axes.transData, borderaxespad=0, fontsize=FONT_POINTS, frameon=False,
        labelcolor=INK, handlelength=1.6, columnspacing=1.4,
    )  # fmt: skip
    return _STRIP_POINTS if fits_beside else _STRIP_POINTS * (2.0 + 0.6 * math.ceil(len(labels) / columns))


def _fit(figure: Figure, axes: Axes, sheet: Sheet, below_points: float) -> None:
    """Set the size of a figure so that it shows exactly the drawn area, to scale."""
    edge = _MARGIN_POINTS * sheet.mm_per_point
    low_x, high_x = sheet.low_x - edge, sheet.high_x + edge
    low_y, high_y = sheet.below(below_points), sheet.above(_TITLE_POINTS)
    per_inch = 72.0 * sheet.mm_per_point
    figure.set_size_inches((high_x - low_x) / per_inch, (high_y - low_y) / per_inch)
    axes.set_xlim(low_x, high_x)
    axes.set_ylim(low_y, high_y)
    axes.axis("off")


def _draw_path(axes: Axes, path: NDArray[np.float64], color: str, name: str) -> None:
    points = np.asarray(path, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] < 2:
        raise ValueError(f"a path has the shape {points.shape}; expected (n, 2) or (n, 3)")
    points = points[np.isfinite(points[:, :2]).all(axis=1)]
    if not len(points):
        return
    axes.plot(points[:, 0], points[:, 1], "-", color=color, linewidth=1.4, alpha=0.9, label=name, zorder=4)
    begin, end = points[0, :2], points[-1, :2]
    axes.plot(*begin, "o", color="white", markeredgecolor=color, markeredgewidth=1.6, markersize=8, zorder=5)
    axes.plot(*end, "s", color=color, markeredgecolor="white", markersize=9, zorder=6)


def draw_start(axes: Axes, start: Pose) -> None:
    """Draw the robot where it starts, as a triangle that points to the front."""
    axes.plot(
        start.x_mm, start.y_mm, marker=(3, 0, start.heading_deg), color=SERIES[0], markersize=11,
        linestyle="none", markeredgecolor="white", label="start", zorder=5,
    )  # fmt: skip


def draw_docks(axes: Axes, docks: Sequence[Pose]) -> None:
    """Draw triangles that point where the docked robots look."""
    for i, dock in enumerate(docks):
        axes.plot(
            dock.x_mm, dock.y_mm, marker=(3, 0, dock.heading_deg), color=DOCK, markersize=10,
            linestyle="none", markeredgecolor="white", label="dock" if i == 0 else "_", zorder=3.5,
        )  # fmt: skip


def draw_holes(axes: Axes, holes: Sequence[NDArray[np.float64]]) -> None:
    """Hatch the holes in the floor, polygons (n, 2) each."""
    for i, hole in enumerate(holes):
        axes.add_patch(
            Polygon(
                hole, facecolor=PAPER, edgecolor=INK, hatch="xxx", linewidth=0.8,
                label="hole" if i == 0 else "_", zorder=1.5,
            )
        )  # fmt: skip


def _draw_scale(axes: Axes, sheet: Sheet) -> None:
    """Draw a scale bar of a round length, at most a sixth of the building."""
    max_length = (sheet.high_x - sheet.low_x) / _SCALE_DIVISOR
    power = 10.0 ** math.floor(math.log10(max_length))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= max_length)
    x, y = sheet.low_x, sheet.below(_STRIP_POINTS / 2)
    axes.plot([x, x + length], [y, y], color=INK, linewidth=2.0, solid_capstyle="butt", zorder=3)
    text_x = x + length + 8.0 * sheet.mm_per_point
    axes.text(text_x, y, f"{length / 1000.0:g} m", fontsize=9, color=INK, va="center")
