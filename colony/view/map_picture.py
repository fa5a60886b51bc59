"""Pictures of maps: walls, doors, elevators and lights, and the paths of robots.

Figures are built without matplotlib's global state, and a picture depends on its content only: the same
content gives the same SVG file, byte for byte.
"""

from __future__ import annotations

import io
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from numpy.typing import NDArray

from colony.nav.maps.stickrep.geometry import Point, corners, link_endpoints, shared_lights
from colony.nav.maps.stickrep.model import EdgeKind, Map
from colony.nav.maps.walls import Walls, lights_of, walls_of
from colony.view.map_names import FONT_POINTS, WEIGHTS, Box, Name, Rank, place_names
from colony.view.palette import FLOOR, INK, MUTED, PAPER, SERIES

PictureFormat = Literal["png", "svg"]

_DOOR, _ELEVATOR, _LIGHT, _LINK = "#c8752a", "#7a4fb5", "#f2c53d", "#0f8f86"
_MIN_INCHES, _MAX_INCHES = 11.0, 24.0
_MM_PER_INCH = 6_500.0  # pictures of large buildings are larger, so that names are legible
_MARGIN_POINTS = 16.0
_TITLE_POINTS, _STRIP_POINTS = 40.0, 28.0
_LEGEND_MARK_POINTS, _LETTER_POINTS = 38.0, 4.6  # maximum widths, in the legend
_SCALE_DIVISOR = 6.0
_DPI = 150


def picture_format(path: str | os.PathLike[str]) -> PictureFormat:
    """Return the picture format for a file's suffix.

    Raises:
        ValueError: the suffix is neither `.png` nor `.svg`.
    """
    match Path(path).suffix.lower():
        case ".png":
            return "png"
        case ".svg":
            return "svg"
        case _:
            raise ValueError(f"cannot draw into `{os.fspath(path)}`; expected a file ending in .png or .svg")


def draw_map(
    map_: Map,
    paths: Sequence[NDArray[np.float64]] = (),
    title: str | None = None,
    names: Sequence[str] = (),
) -> Figure:
    """Draw a map, and return the figure.

    Args:
        map_: the map.
        paths: the paths of robots, each (n, 2) or (n, 3), x and y in mm, in driving order; points that are
            not finite are left out.
        title: the title; the map's name by default.
        names: names of the robots in the legend.
    """
    walls = walls_of(map_)
    sheet, placed = _sheet_for(map_, walls)
    figure = Figure(dpi=_DPI, facecolor=PAPER)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    _draw_floor(axes, map_)
    _draw_edges(axes, walls)
    _draw_links(axes, map_)
    _draw_lights(axes, map_)
    _draw_names(axes, placed)
    if paths:
        for i, path in enumerate(paths):
            name = names[i] if i < len(names) else ("robot" if len(paths) == 1 else f"robot {i}")
            name += " (○ start, ■ end)" if i == 0 else ""
            label = name if i < len(SERIES) else "_"
            _draw_path(axes, path, SERIES[i % len(SERIES)], label)
    else:
        _draw_start(axes, map_)
    _draw_scale(axes, sheet)
    axes.text(
        sheet.low_x, sheet.above(_TITLE_POINTS / 2), title or map_.name,
        fontsize=13, color=INK, weight="bold", va="center",
    )  # fmt: skip
    _fit(figure, axes, sheet, _draw_legend(axes, sheet))
    return figure


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sheet:
    """The scale of a picture, and the bounding box of the building and its names, in mm."""

    low_x: float
    low_y: float
    high_x: float
    high_y: float
    mm_per_point: float

    @property
    def width_points(self) -> float:
        """Width of the building and its names."""
        return (self.high_x - self.low_x) / self.mm_per_point

    def above(self, points: float) -> float:
        """Return the y coordinate that is `points` above the building and its names."""
        return self.high_y + points * self.mm_per_point

    def below(self, points: float) -> float:
        """Return the y coordinate that is `points` below the building and its names."""
        return self.low_y - points * self.mm_per_point


def _sheet_for(map_: Map, walls: Walls) -> tuple[_Sheet, tuple[Name, ...]]:
    """Return the sheet for a map, and the placed names on it."""
    low_x, low_y, high_x, high_y = walls.bounds
    long_side = max(high_x - low_x, high_y - low_y)
    scale = long_side / (72.0 * min(max(_MIN_INCHES, long_side / _MM_PER_INCH), _MAX_INCHES))
    names = place_names(map_, scale)
    boxes = [Box(low_x, low_y, high_x, high_y), *(name.box for name in names)]
    sheet = _Sheet(
        low_x=min(box.low_x for box in boxes),
        low_y=min(box.low_y for box in boxes),
        high_x=max(box.high_x for box in boxes),
        high_y=max(box.high_y for box in boxes),
        mm_per_point=scale,
    )
    return sheet, names


def _draw_legend(axes: Axes, sheet: _Sheet) -> float:
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


def _fit(figure: Figure, axes: Axes, sheet: _Sheet, below_points: float) -> None:
    """Set the size of a figure so that it shows exactly the drawn area, to scale."""
    edge = _MARGIN_POINTS * sheet.mm_per_point
    low_x, high_x = sheet.low_x - edge, sheet.high_x + edge
    low_y, high_y = sheet.below(below_points), sheet.above(_TITLE_POINTS)
    per_inch = 72.0 * sheet.mm_per_point
    figure.set_size_inches((high_x - low_x) / per_inch, (high_y - low_y) / per_inch)
    axes.set_xlim(low_x, high_x)
    axes.set_ylim(low_y, high_y)
    axes.axis("off")


def encode_picture(figure: Figure, format_: PictureFormat) -> bytes:
    """Encode a figure as the content of a file."""
    image = io.BytesIO()
    canvas: Any
    if format_ == "svg":
        canvas = FigureCanvasSVG(figure)
        with matplotlib.rc_context({"svg.hashsalt": "colony", "svg.fonttype": "path"}):
            canvas.print_svg(image, metadata={"Date": None})
    else:
        canvas = FigureCanvasAgg(figure)
        canvas.print_png(image, metadata={"Software": None})
    return image.getvalue()


def _draw_floor(axes: Axes, map_: Map) -> None:
    """Fill the free space; outlines and blocks wind in opposite directions, which leaves the blocks out."""
    vertices: list[Point] = []
    codes: list[np.uint8] = []
    for ring in map_.rings:
        nodes = corners(ring)
        vertices += [*nodes, nodes[0]]
        codes += [Outline.MOVETO, *([Outline.LINETO] * (len(nodes) - 1)), Outline.CLOSEPOLY]
    axes.add_patch(PathPatch(Outline(vertices, codes), facecolor=FLOOR, edgecolor="none", zorder=1))


def _draw_edges(axes: Axes, walls: Walls) -> None:
    styles = (
        (EdgeKind.WALL, INK, 2.2, "wall"),
        (EdgeKind.DOOR, _DOOR, 4.5, "door"),
        (EdgeKind.ELEVATOR, _ELEVATOR, 4.5, "elevator"),
    )
    for kind, color, width, label in styles:
        segments = walls.segments[[k is kind for k in walls.kinds]].reshape(-1, 2, 2)
        if len(segments):
            capstyle = "projecting" if kind is EdgeKind.WALL else "butt"
            lines = LineCollection(
                list(segments), colors=color, linewidths=width, label=label, capstyle=capstyle, zorder=2
            )
            axes.add_collection(lines)


_NAME_COLORS: dict[Rank, str] = {"elevator": _ELEVATOR, "door": MUTED, "corner": INK}


def _draw_names(axes: Axes, names: Sequence[Name]) -> None:
    """Draw the names of corners, doors and elevators behind their walls."""
    for name in names:
        axes.text(
            name.center.x, name.center.y, name.text, fontsize=FONT_POINTS, color=_NAME_COLORS[name.rank],
            weight=WEIGHTS[name.rank], ha="center", va="center", rotation=90.0 if name.upright else 0.0,
        )  # fmt: skip


def _draw_lights(axes: Axes, map_: Map) -> None:
    """Draw discs for the lights of the corridors, diamonds for those of the turning spaces."""
    lights = lights_of(map_)
    turning_space_lights = sum(len(shared_lights(ring) or ()) for ring in map_.rings)
    corridor_lights = len(lights) - turning_space_lights
    for group, marker, label in (
        (lights[:corridor_lights], "o", "ceiling light"),
        (lights[corridor_lights:], "D", "light of a turning space"),
    ):
        if len(group):
            axes.plot(
                group[:, 0], group[:, 1], marker, color=_LIGHT, markersize=5, markeredgecolor="#b08a10",
                markeredgewidth=0.6, label=label, zorder=3,
            )  # fmt: skip


def _draw_links(axes: Axes, map_: Map) -> None:
    """Draw a line between the two ends of each link."""
    links = link_endpoints(map_)
    if links:
        lines = LineCollection(
            list(links), colors=_LINK, linewidths=1.2, linestyles=(0, (2, 2)), label="link", zorder=2.5
        )
        axes.add_collection(lines)


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


def _draw_start(axes: Axes, map_: Map) -> None:
    """Draw the robot where it starts, as a triangle that points to the front."""
    start = map_.start
    axes.plot(
        start.x_mm, start.y_mm, marker=(3, 0, start.heading_deg), color=SERIES[0], markersize=11,
        linestyle="none", markeredgecolor="white", label="start", zorder=5,
    )  # fmt: skip


def _draw_scale(axes: Axes, sheet: _Sheet) -> None:
    """Draw a scale bar of a round length, at most a sixth of the building."""
    max_length = (sheet.high_x - sheet.low_x) / _SCALE_DIVISOR
    power = 10.0 ** math.floor(math.log10(max_length))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= max_length)
    x, y = sheet.low_x, sheet.below(_STRIP_POINTS / 2)
    axes.plot([x, x + length], [y, y], color=INK, linewidth=2.0, solid_capstyle="butt", zorder=3)
    text_x = x + length + 8.0 * sheet.mm_per_point
    axes.text(text_x, y, f"{length / 1000.0:g} m", fontsize=9, color=INK, va="center")
