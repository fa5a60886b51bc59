"""Pictures of occupancy grids: the cells, the walls around them, and the paths of robots."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.transforms import Affine2D
from numpy.typing import NDArray

from colony.nav.maps.grid.model import Cell, Grid
from colony.nav.maps.stickrep.model import Pose
from colony.nav.maps.world_map import WorldMap
from colony.view.palette import FAINT, FLOOR, INK, MUTED
from colony.view.sheet import (
    Sheet,
    draw_docks,
    draw_paths,
    draw_people,
    draw_start,
    finish,
    mm_per_point,
    new_figure,
)

_COLORS = {Cell.FREE: FLOOR, Cell.OCCUPIED: MUTED, Cell.UNKNOWN: FAINT}


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
        grid.cells, cmap=ListedColormap([_COLORS[state] for state in Cell]), vmin=0, vmax=len(Cell) - 1,
        origin="lower", extent=(0, columns, 0, rows), interpolation="nearest", aspect="auto", zorder=1,
        transform=place + axes.transData,
    )  # fmt: skip
    axes.set_aspect("auto")
    if len(world.walls):
        segments = list(world.walls.reshape(-1, 2, 2))
        axes.add_collection(LineCollection(segments, colors=INK, linewidths=0.9, label="wall", zorder=2))
    for state, name in ((Cell.OCCUPIED, "occupied"), (Cell.UNKNOWN, "unknown")):
        axes.plot([], [], "s", color=_COLORS[state], markersize=8, markeredgecolor=MUTED, label=name)
    draw_docks(axes, world.docks)
    draw_people(axes, people)
    if paths:
        draw_paths(axes, paths, names)
    elif start is not None:
        draw_start(axes, start)
    finish(figure, axes, sheet, world.name)
    return figure
