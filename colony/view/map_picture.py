"""Pictures of maps: walls, doors, elevators and lights, and the paths of robots.

Figures are built without matplotlib's global state, and a picture depends on its content only: the same
content gives the same SVG file, byte for byte.
"""

from __future__ import annotations

import io
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

from colony.nav.maps.stickrep.geometry import Point, corners, link_endpoints, shared_lights
from colony.nav.maps.stickrep.model import EdgeKind, Map
from colony.nav.maps.walls import Walls, lights_of, walls_of
from colony.view.map_names import FONT_POINTS, WEIGHTS, Box, Name, Rank, place_names
from colony.view.palette import FLOOR, INK, MUTED
from colony.view.sheet import (
    Sheet,
    draw_docks,
    draw_holes,
    draw_paths,
    draw_people,
    draw_start,
    finish,
    mm_per_point,
    new_figure,
)

PictureFormat = Literal["png", "svg"]

_DOOR, _ELEVATOR, _LIGHT, _LINK = "#c8752a", "#7a4fb5", "#f2c53d", "#0f8f86"


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
    people: Sequence[NDArray[np.float64]] = (),
) -> Figure:
    """Draw a map, and return the figure.

    Args:
        map_: the map.
        paths: the paths of robots, each (n, 2) or (n, 3), x and y in mm, in driving order; points that are
            not finite are left out.
        title: the title; the map's name by default.
        names: names of the robots in the legend.
        people: the paths of people, each (n, 2).
    """
    walls = walls_of(map_)
    sheet, placed = _sheet_for(map_, walls)
    figure, axes = new_figure()
    _draw_floor(axes, map_)
    draw_holes(axes, [np.array(hole.corners()) for hole in map_.holes])
    _draw_edges(axes, walls)
    _draw_links(axes, map_)
    _draw_lights(axes, map_)
    draw_docks(axes, map_.docks)
    _draw_names(axes, placed)
    draw_people(axes, people)
    if paths:
        draw_paths(axes, paths, names)
    else:
        draw_start(axes, map_.start)
    finish(figure, axes, sheet, title or map_.name)
    return figure


def _sheet_for(map_: Map, walls: Walls) -> tuple[Sheet, tuple[Name, ...]]:
    """Return the sheet for a map, and the placed names on it."""
    low_x, low_y, high_x, high_y = walls.bounds
    scale = mm_per_point(high_x - low_x, high_y - low_y)
    names = place_names(map_, scale)
    boxes = [Box(low_x, low_y, high_x, high_y), *(name.box for name in names)]
    sheet = Sheet(
        low_x=min(box.low_x for box in boxes),
        low_y=min(box.low_y for box in boxes),
        high_x=max(box.high_x for box in boxes),
        high_y=max(box.high_y for box in boxes),
        mm_per_point=scale,
    )
    return sheet, names


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
