"""A picture of many runs: their paths and contacts over the map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from colony.nav.maps.world_map import WorldMap
from colony.view.palette import BAD, GOOD
from colony.view.world_picture import draw_world

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
