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
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from matplotlib.transforms import Affine2D
from numpy.typing import NDArray

from colony.nav.maps.grid.model import Grid, GridCell
from colony.nav.maps.stickrep.geometry import Point, corners, link_endpoints, shared_lights
from colony.nav.maps.stickrep.model import EdgeKind, Map, Pose
from colony.nav.maps.walls import Walls, lights_of, walls_of
from colony.nav.maps.world_map import WorldMap
from colony.nav.plan.plan import Plan, Segment
from colony.nav.shared import GoalKind
from colony.view.sheet import (
    BAD,
    FAINT,
    FLOOR,
    FONT_POINTS,
    GOOD,
    INK,
    MUTED,
    WEIGHTS,
    Box,
    PlacedName,
    Rank,
    Sheet,
    draw_docks,
    draw_holes,
    draw_paths,
    draw_people,
    draw_start,
    finish,
    mm_per_point,
    new_figure,
    place_names,
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


def _sheet_for(map_: Map, walls: Walls) -> tuple[Sheet, tuple[PlacedName, ...]]:
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


def _draw_names(axes: Axes, names: Sequence[PlacedName]) -> None:
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


# --- grid picture -------------------------------------------------------------------------------------
#
# Pictures of occupancy grids: the cells, the walls around them, and the paths of robots.

_COLORS = {GridCell.FREE: FLOOR, GridCell.OCCUPIED: MUTED, GridCell.UNKNOWN: FAINT}


def draw_grid(
    world: WorldMap,
    grid: Grid,
    paths: Sequence[NDArray[np.float64]] = (),
    names: Sequence[str] = (),
    start: Pose | None = None,
    people: Sequence[NDArray[np.float64]] = (),
) -> Figure:
    """Draw a grid, and return the figure.

    Args:
        world: the world of the grid.
        grid: the grid.
        paths: the paths of robots, each (n, 2) or (n, 3), x and y in mm, in driving order.
        names: names of the robots in the legend.
        start: the pose of a robot, which is drawn if there are no paths.
        people: the paths of people, each (n, 2).
    """
    rows, columns = grid.cells.shape
    corners = grid.to_world(np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], dtype=np.float64))
    (low_x, low_y), (high_x, high_y) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    sheet = Sheet(
        low_x=low_x,
        low_y=low_y,
        high_x=high_x,
        high_y=high_y,
        mm_per_point=mm_per_point(high_x - low_x, high_y - low_y),
    )
    figure, axes = new_figure()
    place = Affine2D().scale(grid.cell_mm).rotate_deg(grid.yaw_deg).translate(grid.x_mm, grid.y_mm)
    axes.imshow(
        grid.cells, cmap=ListedColormap([_COLORS[state] for state in GridCell]), vmin=0,
        vmax=len(GridCell) - 1,
        origin="lower", extent=(0, columns, 0, rows), interpolation="nearest", aspect="auto", zorder=1,
        transform=place + axes.transData,
    )  # fmt: skip
    axes.set_aspect("auto")
    if len(world.walls):
        segments = list(world.walls.reshape(-1, 2, 2))
        axes.add_collection(LineCollection(segments, colors=INK, linewidths=0.9, label="wall", zorder=2))
    for state, name in ((GridCell.OCCUPIED, "occupied"), (GridCell.UNKNOWN, "unknown")):
        axes.plot([], [], "s", color=_COLORS[state], markersize=8, markeredgecolor=MUTED, label=name)
    draw_docks(axes, world.docks)
    draw_people(axes, people)
    if paths:
        draw_paths(axes, paths, names)
    elif start is not None:
        draw_start(axes, start)
    finish(figure, axes, sheet, world.name)
    return figure


# --- world picture ------------------------------------------------------------------------------------
#
# Pictures of simulated worlds, whatever the format of their maps.


def draw_world(
    world: WorldMap,
    paths: Sequence[NDArray[np.float64]] = (),
    names: Sequence[str] = (),
    start: Pose | None = None,
    people: Sequence[NDArray[np.float64]] = (),
) -> Figure:
    """Draw a world, and return the figure.

    Args:
        world: the world.
        paths: the paths of robots, each (n, 2) or (n, 3), x and y in mm, in driving order; points that are
            not finite are left out.
        names: names of the robots in the legend.
        start: the pose of a robot in a grid, drawn if there are no paths; a StickRep map has its own.
        people: the paths of people, each (n, 2).
    """
    match world.source:
        case Map():
            return draw_map(world.source, paths, names=names, people=people)
        case Grid():
            return draw_grid(world, world.source, paths, names, start, people)


# --- plan picture -------------------------------------------------------------------------------------
#
# Pictures of plans: the path on the map, with the mode of each segment and the lights to be tracked.

_SEGMENT_COLORS = {
    GoalKind.LIGHTS: "#1769d6",
    GoalKind.ENTER_CORNER: "#0f9d76",
    GoalKind.CORNER: "#c2335f",
    GoalKind.DEAD_RECKONING: "#5d6b00",
    GoalKind.ELEVATOR: "#7a4fb5",
}
_MIN_LETTERED_MM = 1400.0
"""Minimum length of a segment that shows its letter."""


def draw_plan(map_: Map, plan: Plan, title: str | None = None) -> Figure:
    """Draw the part of a plan on one floor: L, E, C and D are the modes of the Navigator.

    Args:
        map_: the map of the floor.
        plan: a plan for that map, or for a building with that floor.
        title: the title.
    """
    segments = [s for s in plan.segments if map_.name in (s.start.floor, s.end.floor)]
    path_parts = _path_parts(segments, map_.name)
    figure = draw_map(map_, path_parts, title or f"{plan.origin} to {plan.goal}", ["plan"])
    axes = figure.axes[0]
    for segment in segments:
        if segment.start.floor == segment.end.floor:
            _draw_segment(axes, segment)
    return figure


def _path_parts(segments: list[Segment], floor: str) -> list[np.ndarray]:
    """Return the contiguous parts of the path on one floor."""
    parts: list[list[tuple[float, float]]] = [[]]
    for segment in segments:
        if segment.start.floor == floor:
            if not parts[-1]:
                parts[-1].append((segment.start.x_mm, segment.start.y_mm))
            if segment.end.floor == floor:
                parts[-1].append((segment.end.x_mm, segment.end.y_mm))
                continue
        parts.append([])
    return [np.array(part, dtype=np.float64) for part in parts if part]


def _draw_segment(axes: Axes, segment: Segment) -> None:
    (x0, y0, _), (x1, y1, _) = segment.start, segment.end
    color = _SEGMENT_COLORS[segment.kind]
    axes.plot([x0, x1], [y0, y1], "-", color=color, linewidth=3.0, solid_capstyle="butt", zorder=4.5)
    length = segment.length_mm
    for light in segment.lights_mm:
        fraction = light / length
        axes.plot(
            x0 + fraction * (x1 - x0), y0 + fraction * (y1 - y0), "o",
            markerfacecolor="none", markeredgecolor=color, markersize=9, zorder=5,
        )  # fmt: skip
    if length >= _MIN_LETTERED_MM:
        axes.text(
            (x0 + x1) / 2, (y0 + y1) / 2, chr(segment.kind), fontsize=7, weight="bold", color="white",
            ha="center", va="center", zorder=7,
            bbox={"boxstyle": "circle,pad=0.2", "facecolor": color, "edgecolor": "white"},
        )  # fmt: skip


# --- runs picture -------------------------------------------------------------------------------------
#
# A picture of many runs: their paths and contacts over the map.

Points = Sequence[tuple[int, int]]


def draw_runs(world: WorldMap, runs: Sequence[tuple[Points, Points, bool]]) -> Figure:
    """Draw a world with the paths of many runs, bad ones on top, and return the figure.

    Args:
        world: the world.
        runs: the path of each run, the places of its contacts, x and y in mm, and True for a bad run.
    """
    figure = draw_world(world, [np.empty((0, 2))], names=["runs"])
    axes = figure.axes[0]
    remove_legend(figure)
    for bad, color, width, alpha in ((False, GOOD, 0.7, 0.35), (True, BAD, 0.9, 0.6)):
        paths = [np.array(path, dtype=float) for path, _, is_bad in runs if is_bad is bad and len(path) > 1]
        axes.add_collection(LineCollection(paths, colors=color, linewidths=width, alpha=alpha, zorder=6))
    contacts = np.array([place for _, places, _ in runs for place in places], dtype=float).reshape(-1, 2)
    axes.scatter(contacts[:, 0], contacts[:, 1], marker="x", s=18, c=BAD, linewidths=1.2, zorder=7)
    return figure


def remove_legend(figure: Figure) -> None:
    """Remove the legend of a picture, in which runs have no names."""
    for legend in [figure.axes[0].get_legend(), *figure.legends]:
        if legend is not None:
            legend.remove()
