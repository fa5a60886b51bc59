"""Pictures of experiments: the paths of robots, and the errors of their final positions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from colony.nav.maps.stickrep.model import Map
from colony.view.map_picture import draw_map, encode_picture, remove_legend
from colony.view.sheet import BAD, GOOD, INK, PAPER

_BIN_MM = 20.0
_DPI = 150


class DrivenPath(NamedTuple):
    """The path of a run, x and y in mm, and True if it reached the goal."""

    path: Sequence[tuple[int, int]]
    reached: bool
    seed: int


def draw_paths(map_: Map, drives: Sequence[DrivenPath], title: str) -> Figure:
    """Draw a map with the paths of many runs: failed ones on top, each ending in a cross."""
    figure = draw_map(map_, [np.empty((0, 2))], title, ["runs"])
    axes = figure.axes[0]
    remove_legend(figure)
    for reached, color, width, alpha in ((True, GOOD, 1.2, 0.6), (False, BAD, 1.8, 0.9)):
        paths = [np.array(d.path, dtype=float) for d in drives if d.reached is reached and len(d.path) > 1]
        axes.add_collection(
            LineCollection(paths, colors=color, linewidths=width, alpha=alpha, zorder=6, capstyle="round")
        )
        ends = np.array([path[-1] for path in paths]).reshape(-1, 2)
        axes.scatter(
            ends[:, 0], ends[:, 1], marker="o" if reached else "x", s=14, c=color, zorder=7, linewidths=1.2
        )
    return figure


def draw_errors(overshoots_mm: Sequence[float], title: str) -> Figure:
    """Draw a histogram of the distances by which robots overshot their goals, up to a meter."""
    figure = Figure(figsize=(8.0, 4.0), dpi=_DPI, facecolor=PAPER, layout="constrained")
    axes = figure.add_subplot()
    values = np.clip(np.array(overshoots_mm, dtype=float), -1000.0, 1000.0)
    limit = max(200.0, _BIN_MM * math.ceil(np.abs(values).max(initial=0.0) / _BIN_MM))
    axes.hist(values / 1000.0, bins=list(np.arange(-limit, limit + _BIN_MM, _BIN_MM) / 1000.0), color=GOOD)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_xlabel("beyond the goal, along the last leg (m)", color=INK)
    axes.set_ylabel("runs", color=INK)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_title(f"{title}: {len(values)} runs that reached the goal", color=INK, loc="left")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def encode(figure: Figure) -> bytes:
    """Encode a PNG; the same for the same picture, byte for byte."""
    return encode_picture(figure, "png")
