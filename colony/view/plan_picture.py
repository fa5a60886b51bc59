"""Pictures of plans: the path on the map, with the mode of each segment and the lights to be tracked."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from colony.nav.maps.stickrep.model import Map
from colony.nav.plan.plan import Plan, Segment
from colony.nav.shared import GoalKind
from colony.view.map_picture import draw_map

_COLORS = {
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
    color = _COLORS[segment.kind]
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
