"""Pictures of simulated worlds, whatever the format of their maps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from colony.nav.maps.grid.model import Grid
from colony.nav.maps.stickrep.model import Map, Pose
from colony.nav.maps.world_map import WorldMap
from colony.view.grid_picture import draw_grid
from colony.view.map_picture import draw_map


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
