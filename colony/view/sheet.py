"""What pictures of worlds have in common: the sheet and its scale, the legend, the paths of robots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from colony.nav.maps.stickrep.model import Pose
from colony.view.map_names import FONT_POINTS
from colony.view.palette import INK, PAPER, SERIES

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
