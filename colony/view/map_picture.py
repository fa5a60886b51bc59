"""Pictures of maps: walls, doors, elevators and lights, and the ways that robots took.

Figures are built without matplotlib's global state, and a picture depends on nothing but what is drawn: SVG
files come out the same byte for byte.
"""

from __future__ import annotations

import io
import math
import os
from collections.abc import Sequence
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

from colony.nav.stickrep import EdgeKind, Map
from colony.nav.stickrep_geometry import Point, corners
from colony.nav.walls import Walls, lights_of, walls_of

PictureFormat = Literal["png", "svg"]

_INK, _MUTED, _PAPER, _FLOOR = "#2b2f36", "#7a8290", "#eceef1", "#ffffff"
_DOOR, _ELEVATOR, _LIGHT = "#c8752a", "#7a4fb5", "#f2c53d"
_PATHS = ("#1769d6", "#0f9d76", "#c2335f", "#5d6b00", "#8a3fb8", "#00879e")
_LONG_SIDE_INCHES = 12.0
_DPI = 150


def picture_format(path: str | os.PathLike[str]) -> PictureFormat:
    """The format that a file's ending asks for.

    Raises:
        ValueError: the ending is another one.
    """
    match Path(path).suffix.lower():
        case ".png":
            return "png"
        case ".svg":
            return "svg"
        case _:
            raise ValueError(f"cannot draw into `{os.fspath(path)}`; expected a file ending in .png or .svg")


def draw_map(
    drawn: Map,
    paths: Sequence[NDArray[np.float64]] = (),
    title: str | None = None,
    names: Sequence[str] = (),
) -> Figure:
    """A figure of a map.

    Args:
        drawn: the map.
        paths: the ways of robots, each (n, 2) or (n, 3), x and y in mm, in the order in which they were
            driven; places that are not finite are left out.
        title: what to write above; the map's name by default.
        names: what the robots are called in the legend.
    """
    walls = walls_of(drawn)
    low_x, low_y, high_x, high_y = walls.bounds
    margin = 0.06 * max(high_x - low_x, high_y - low_y)
    rows = _legend_rows(high_x - low_x + 2 * margin, margin, len(paths))
    bottom = low_y - (1.6 + 0.45 * (rows - 1)) * margin
    figure, axes = _sheet(low_x - margin, bottom, high_x + margin, high_y + 1.2 * margin)
    _draw_floor(axes, drawn)
    _draw_edges(axes, walls)
    lights = lights_of(drawn)
    axes.plot(
        lights[:, 0], lights[:, 1], "o", color=_LIGHT, markersize=5, markeredgecolor="#b08a10",
        markeredgewidth=0.6, label="ceiling light", zorder=3,
    )  # fmt: skip
    _draw_names(axes, drawn, margin)
    if paths:
        for i, path in enumerate(paths):
            name = names[i] if i < len(names) else ("robot" if len(paths) == 1 else f"robot {i}")
            name += " (○ start, ■ end)" if i == 0 else ""
            label = name if i < len(_PATHS) else "_"
            _draw_path(axes, path, _PATHS[i % len(_PATHS)], label)
    else:
        _draw_start(axes, drawn)
    _draw_scale(axes, low_x, low_y - 0.85 * margin, high_x - low_x)
    axes.text(
        low_x, high_y + 0.75 * margin, title or drawn.name,
        fontsize=13, color=_INK, weight="bold", va="center",
    )  # fmt: skip
    beside = rows == 1
    axes.legend(
        loc="center right" if beside else "upper left", ncols=12 if beside else 2,
        bbox_to_anchor=(high_x, low_y - 0.85 * margin) if beside else (low_x, low_y - 1.15 * margin),
        bbox_transform=axes.transData, borderaxespad=0, fontsize=8, frameon=False, labelcolor=_INK,
        handlelength=1.6, columnspacing=1.4,
    )  # fmt: skip
    return figure


_ENTRY_INCHES = 1.6


def _legend_rows(width: float, margin: float, paths: int) -> int:
    """How many rows of the legend: one beside the scale bar if there is room, else two columns below it."""
    entries = 4 + min(max(paths, 1), len(_PATHS))
    inches = _LONG_SIDE_INCHES * width / max(width, margin / 0.06)
    return 1 if entries * _ENTRY_INCHES < 0.75 * inches else 1 + (entries + 1) // 2


def encode_picture(figure: Figure, form: PictureFormat) -> bytes:
    """A figure as the content of a file."""
    image = io.BytesIO()
    canvas: Any
    if form == "svg":
        canvas = FigureCanvasSVG(figure)
        with matplotlib.rc_context({"svg.hashsalt": "colony", "svg.fonttype": "path"}):
            canvas.print_svg(image, metadata={"Date": None})
    else:
        canvas = FigureCanvasAgg(figure)
        canvas.print_png(image, metadata={"Software": None})
    return image.getvalue()


def _sheet(low_x: float, low_y: float, high_x: float, high_y: float) -> tuple[Figure, Axes]:
    """An empty figure that shows just this part of the plane, to scale."""
    width, height = high_x - low_x, high_y - low_y
    scale = _LONG_SIDE_INCHES / max(width, height)
    figure = Figure(figsize=(width * scale, max(height * scale, 2.5)), dpi=_DPI, facecolor=_PAPER)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(low_x, high_x)
    axes.set_ylim(low_y, high_y)
    axes.set_aspect("equal", adjustable="datalim")
    axes.axis("off")
    return figure, axes


def _draw_floor(axes: Axes, drawn: Map) -> None:
    """Fill the free space; outlines and blocks run opposite ways, which leaves the blocks out."""
    vertices: list[Point] = []
    codes: list[np.uint8] = []
    for ring in drawn.rings:
        nodes = corners(ring)
        vertices += [*nodes, nodes[0]]
        codes += [Outline.MOVETO, *([Outline.LINETO] * (len(nodes) - 1)), Outline.CLOSEPOLY]
    axes.add_patch(PathPatch(Outline(vertices, codes), facecolor=_FLOOR, edgecolor="none", zorder=1))


def _draw_edges(axes: Axes, walls: Walls) -> None:
    styles = (
        (EdgeKind.WALL, _INK, 2.2, "wall"),
        (EdgeKind.DOOR, _DOOR, 4.5, "door"),
        (EdgeKind.ELEVATOR, _ELEVATOR, 4.5, "elevator"),
    )
    for kind, color, width, label in styles:
        chosen = walls.segments[[k is kind for k in walls.kinds]].reshape(-1, 2, 2)
        if len(chosen):
            capped = "projecting" if kind is EdgeKind.WALL else "butt"
            lines = LineCollection(
                list(chosen), colors=color, linewidths=width, label=label, capstyle=capped, zorder=2
            )
            axes.add_collection(lines)


_NAME_SPACING = 0.035
"""Names nearer to each other than this part of the building's longer side are left out."""


def _draw_names(axes: Axes, drawn: Map, margin: float) -> None:
    """Write the names of nodes behind their walls: corners first, then doors, as far as there is room."""
    low_x, low_y, high_x, high_y = walls_of(drawn).bounds
    apart = _NAME_SPACING * max(high_x - low_x, high_y - low_y)
    wanted: list[tuple[int, str, Point, Point]] = []
    for ring in drawn.rings:
        nodes = corners(ring)
        for i, (node, edge) in enumerate(zip(ring.nodes, ring.edges, strict=True)):
            here, there, last = nodes[i], nodes[(i + 1) % len(nodes)], nodes[i - 1]
            after, before = _left_of(here, there), _left_of(last, here)
            if node.corner:
                wanted.append((0, node.name, here, Point(after.x + before.x, after.y + before.y)))
            elif edge.kind is not EdgeKind.WALL:
                middle = Point((here.x + there.x) / 2, (here.y + there.y) / 2)
                wanted.append((1, _without_side(node.name), middle, after))
    placed: list[Point] = []
    for rank, name, at, out in sorted(wanted, key=lambda w: w[0]):
        length = math.hypot(out.x, out.y) or 1.0
        spot = Point(at.x + 0.32 * margin * out.x / length, at.y + 0.32 * margin * out.y / length)
        if all(math.hypot(spot.x - p.x, spot.y - p.y) >= apart for p in placed):
            placed.append(spot)
            color, weight = (_INK, "bold") if rank == 0 else (_MUTED, "normal")
            axes.text(spot.x, spot.y, name, fontsize=8, color=color, weight=weight, ha="center", va="center")


def _without_side(name: str) -> str:
    """A door's name from that of its left jamb: `101L` gives `101`."""
    return name[:-1] if len(name) > 1 and name[-1] == "L" else name


def _left_of(here: Point, there: Point) -> Point:
    """The unit vector behind a wall, on the left of who walks along it."""
    length = math.hypot(there.x - here.x, there.y - here.y)
    return Point(-(there.y - here.y) / length, (there.x - here.x) / length)


def _draw_path(axes: Axes, path: NDArray[np.float64], color: str, name: str) -> None:
    places = np.asarray(path, dtype=np.float64)
    if places.ndim != 2 or places.shape[1] < 2:
        raise ValueError(f"a path has the shape {places.shape}; expected (n, 2) or (n, 3)")
    places = places[np.isfinite(places[:, :2]).all(axis=1)]
    if not len(places):
        return
    axes.plot(places[:, 0], places[:, 1], "-", color=color, linewidth=1.4, alpha=0.9, label=name, zorder=4)
    begin, end = places[0, :2], places[-1, :2]
    axes.plot(*begin, "o", color="white", markeredgecolor=color, markeredgewidth=1.6, markersize=8, zorder=5)
    axes.plot(*end, "s", color=color, markeredgecolor="white", markersize=9, zorder=6)


def _draw_start(axes: Axes, drawn: Map) -> None:
    """The robot where it starts, as a disc with a line to the front."""
    start = drawn.start
    axes.plot(
        start.x_mm, start.y_mm, marker=(3, 0, start.heading_deg), color=_PATHS[0], markersize=11,
        linestyle="none", markeredgecolor="white", label="start", zorder=5,
    )  # fmt: skip


def _draw_scale(axes: Axes, x: float, y: float, width: float) -> None:
    """A scale bar of a round length, about a sixth of the building."""
    rough = width / 6.0
    power = 10.0 ** math.floor(math.log10(rough))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= rough)
    axes.plot([x, x + length], [y, y], color=_INK, linewidth=2.0, solid_capstyle="butt", zorder=3)
    axes.text(x + length + 0.012 * width, y, f"{length / 1000.0:g} m", fontsize=9, color=_INK, va="center")
