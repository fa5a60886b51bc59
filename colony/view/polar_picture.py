"""Polar pictures: the readings of arrays with bearings around the robot, and what was decided.

Ahead is up, and 90 degrees is left. Ranges are drawn from the robot's center, wherever the sensors are on it.
"""

from __future__ import annotations

import math
import textwrap
from collections import Counter
from typing import Any, assert_never

from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from colony.ir.bearings import Bearings
from colony.view.frame_scene import Mark, Panel, Ranges, Scene, States, quantity
from colony.view.palette import BAD, FAINT, FLOOR, GOOD, INK, MUTED, PAPER, SERIES
from colony.view.polar import Sector, blind_sector, label_bearing, layers, outline, point, sectors

_COLUMNS = 3
_PANEL_INCHES, _LONE_PANEL_INCHES = 4.4, 6.0
_NAME_INCHES, _NOTE_INCHES = 0.22, 0.19
_BELOW_PANEL_INCHES, _BETWEEN_PANELS_INCHES = 0.5, 0.25
_TITLE_INCHES, _LINE_INCHES, _MARGIN_INCHES = 0.6, 0.22, 0.25
_LETTER_INCHES = 0.075
_REACH = 1.2
"""Half the width of a panel, in radii of the outermost ring."""
_WIDEST_BEAM_DEG = 15.0
_INNER = 0.35
"""Inner radius of the sectors of bools and enumerators."""
_RIM, _CENTER = 1.04, 0.07
"""Radii of marks without a value: beyond the outermost ring, and beside the robot."""
_DPI = 150

_MARKERS: dict[Mark, str] = {"reading": "o", "limit": "o", "infinite": "^", "negative": "v", "invalid": "X"}
_STATE_COLORS = (FLOOR, GOOD)
_ENUM_COLORS = ("#f5dd93", *SERIES)


def draw_scene(scene: Scene) -> Figure:
    """Draw a frame: a panel for each array with bearings, and the decisions below them."""
    columns = min(len(scene.panels), _COLUMNS)
    rows = math.ceil(len(scene.panels) / columns)
    side = _LONE_PANEL_INCHES if columns == 1 else _PANEL_INCHES
    width = columns * (side + _BETWEEN_PANELS_INCHES) - _BETWEEN_PANELS_INCHES + 2 * _MARGIN_INCHES
    lines = _wrapped(scene.lines, width)
    below = _LINE_INCHES * len(lines) + _MARGIN_INCHES
    above = _NAME_INCHES + _NOTE_INCHES * max(len(panel.notes) for panel in scene.panels)
    row_height = above + side + _BELOW_PANEL_INCHES
    height = _TITLE_INCHES + rows * row_height + below
    figure = Figure(figsize=(width, height), dpi=_DPI, facecolor=PAPER)
    for i, panel in enumerate(scene.panels):
        left = _MARGIN_INCHES + (side + _BETWEEN_PANELS_INCHES) * (i % columns)
        top = height - _TITLE_INCHES - row_height * (i // columns)
        bottom = top - above - side
        axes = figure.add_axes((left / width, bottom / height, side / width, side / height))
        _draw_panel(axes, panel)
        _draw_heading(figure, panel, (left + side / 2) / width, top / height, height)
    title = textwrap.shorten(scene.title, int(width / _LETTER_INCHES / 1.35), placeholder=" ...")
    figure.text(
        _MARGIN_INCHES / width, 1 - 0.3 / height, title,
        fontsize=13, weight="bold", color=INK, va="center", parse_math=False,
    )  # fmt: skip
    for i, line in enumerate(lines):
        y = (below - _LINE_INCHES * (i + 0.5)) / height
        figure.text(_MARGIN_INCHES / width, y, line, fontsize=9.5, color=INK, va="center", parse_math=False)
    return figure


def _wrapped(lines: tuple[str, ...], width_inches: float) -> list[str]:
    letters = int((width_inches - 2 * _MARGIN_INCHES) / _LETTER_INCHES)
    return [part for line in lines for part in textwrap.wrap(line, letters, subsequent_indent="    ")]


def _draw_heading(figure: Figure, panel: Panel, x: float, top: float, height: float) -> None:
    figure.text(
        x, top - 0.1 / height, f"{panel.name}[{len(panel.bearings.angles)}]",
        fontsize=11, weight="bold", color=INK, ha="center", va="center",
    )  # fmt: skip
    for i, note in enumerate(panel.notes):
        y = top - (_NAME_INCHES + 0.09 + _NOTE_INCHES * i) / height
        figure.text(x, y, note, fontsize=8.5, color=MUTED, ha="center", va="center", parse_math=False)


# --- panels --------------------------------------------------------------------------------------


def _draw_panel(axes: Axes, panel: Panel) -> None:
    axes.set_xlim(-_REACH, _REACH)
    axes.set_ylim(-_REACH, _REACH)
    axes.axis("off")
    axes.add_patch(Circle((0.0, 0.0), 1.0, facecolor=FLOOR, edgecolor="none", zorder=0))
    _draw_directions(axes)
    blind = blind_sector(panel.bearings)
    if blind is not None:
        _draw_blind(axes, blind)
    match panel.content:
        case None:
            _draw_missing(axes, panel.bearings)
        case Ranges():
            _draw_ranges(axes, panel.bearings, panel.content, blind)
        case States():
            _draw_states(axes, panel.bearings, panel.content)
        case _:
            assert_never(panel.content)
    axes.add_patch(Circle((0.0, 0.0), 1.0, facecolor="none", edgecolor=MUTED, linewidth=1.0, zorder=2))
    axes.plot(0.0, 0.0, marker=(3, 0, 0), color=INK, markersize=10, markeredgecolor=FLOOR, zorder=8)


def _draw_directions(axes: Axes) -> None:
    """Draw a spoke every 45 degrees, with its bearing outside the rim."""
    spokes = [[point(b, 0.0), point(b, 1.0)] for b in range(-180, 180, 45)]
    axes.add_collection(LineCollection(spokes, colors=FAINT, linewidths=0.7, zorder=1))
    for bearing in range(-135, 181, 45):
        axes.text(*point(bearing, 1.13), f"{bearing}°", fontsize=8, color=MUTED, ha="center", va="center")


def _draw_blind(axes: Axes, blind: Sector) -> None:
    """Shade the sector that no element looks at, and draw the ends of the array."""
    axes.add_collection(
        PolyCollection([outline(blind, 0.0, 1.0)], facecolors=FAINT, alpha=0.6, linewidths=0, zorder=0.5)
    )
    ends = [[point(b, 0.0), point(b, 1.0)] for b in blind]
    axes.add_collection(LineCollection(ends, colors=MUTED, linewidths=1.0, zorder=1.5))


def _draw_missing(axes: Axes, bearings: Bearings) -> None:
    rays = [[point(b, _INNER), point(b, 1.0)] for b in bearings.angles]
    axes.add_collection(
        LineCollection(rays, colors=FAINT, linewidths=min(1.0, 100 / len(rays)), linestyles=":", zorder=1)
    )
    axes.text(
        0.0, -0.17, "missing", fontsize=14, color=BAD, ha="center", va="center", zorder=9,
        bbox={"facecolor": FLOOR, "edgecolor": "none", "pad": 2.0},
    )  # fmt: skip


def _draw_legend(axes: Axes, handles: list[Line2D | Patch]) -> None:
    axes.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.015), ncols=3, fontsize=8, frameon=False,
        labelcolor=INK, handlelength=1.2, columnspacing=1.2, handletextpad=0.5, borderaxespad=0.0,
    )  # fmt: skip


# --- ranges ----------------------------------------------------------------------------------------


def _draw_ranges(axes: Axes, bearings: Bearings, ranges: Ranges, blind: Sector | None) -> None:
    radii = [_radius(ranges, x, mark) for x, mark in zip(ranges.values, ranges.marks, strict=True)]
    _draw_rings(axes, ranges, label_bearing(list(zip(bearings.angles, radii, strict=True)), blind))
    wedges = sectors(bearings, _WIDEST_BEAM_DEG)
    for mark, alpha in (("reading", 0.22), ("limit", 0.07), ("infinite", 0.07)):
        found = [
            outline(wedge, 0.0, min(radius, 1.0))
            for wedge, radius, found_mark in zip(wedges, radii, ranges.marks, strict=True)
            if found_mark == mark
        ]
        axes.add_collection(PolyCollection(found, facecolors=GOOD, alpha=alpha, linewidths=0, zorder=1.2))
    size = min(max(160.0 / len(radii), 1.0), 5.0)
    for mark in _MARKERS:
        places = [
            point(b, r) for b, r, m in zip(bearings.angles, radii, ranges.marks, strict=True) if m == mark
        ]
        axes.plot(
            [p.x for p in places], [p.y for p in places], linestyle="none", zorder=5,
            **_marker(mark, size if mark in ("reading", "limit") else max(size, 4.0)),
        )  # fmt: skip
    counts = Counter(ranges.marks)
    _draw_legend(axes, [_key(mark, counts[mark], ranges) for mark in _MARKERS if counts[mark]])


def _radius(ranges: Ranges, value: float, mark: Mark) -> float:
    match mark:
        case "reading":
            return ranges.scale.radius(value)
        case "limit":
            return ranges.scale.radius(value) if value <= ranges.scale.high else 1.0
        case "infinite" | "invalid":
            return _RIM
        case "negative":
            return _CENTER
        case _:
            assert_never(mark)


def _marker(mark: Mark, size: float) -> dict[str, Any]:
    color = BAD if mark in ("negative", "invalid") else MUTED if mark == "limit" else GOOD
    fill = FLOOR if mark == "limit" else color
    return {
        "marker": _MARKERS[mark], "markersize": size, "markerfacecolor": fill, "markeredgecolor": color,
        "markeredgewidth": min(0.8, size / 4),
    }  # fmt: skip


def _key(mark: Mark, count: int, ranges: Ranges) -> Line2D:
    """Return the entry of a mark in the legend, with the number of elements that have it."""
    match mark:
        case "limit":
            assert ranges.limit is not None
            name = f"{quantity(ranges.limit, ranges.unit)} or more"
        case "reading" | "infinite" | "negative" | "invalid":
            name = mark
        case _:
            assert_never(mark)
    return Line2D([], [], linestyle="none", label=f"{name}: {count}", **_marker(mark, 5.0))


def _draw_rings(axes: Axes, ranges: Ranges, bearing: float) -> None:
    scale = ranges.scale
    for value in scale.rings:
        radius, is_zero = scale.radius(value), value == 0.0
        color, width = (INK, 1.2) if is_zero else (FAINT, 0.8)
        ring = Circle((0.0, 0.0), radius, facecolor="none", edgecolor=color, linewidth=width, zorder=1)
        axes.add_patch(ring)
        axes.text(
            *point(bearing, radius), quantity(value, ranges.unit), fontsize=8, color=INK, ha="center",
            va="center", zorder=7,
            bbox={"facecolor": FLOOR, "edgecolor": "none", "alpha": 0.8, "pad": 1.0}, parse_math=False,
        )  # fmt: skip


# --- bools and enumerators -------------------------------------------------------------------------


def _draw_states(axes: Axes, bearings: Bearings, content: States) -> None:
    colors = _STATE_COLORS if content.names == ("false", "true") else _ENUM_COLORS
    places, fills = [], []
    for sector, layer, state in zip(sectors(bearings), layers(bearings), content.states, strict=True):
        depth = (1.0 - _INNER) / layer.total
        inner = _INNER + depth * layer.number
        places.append(outline(sector, inner, inner + depth))
        fills.append(BAD if state is None else colors[state % len(colors)])
    width = min(0.8, 60.0 / len(places))
    axes.add_collection(
        PolyCollection(places, facecolors=fills, edgecolors=MUTED, linewidths=width, zorder=1.2)
    )
    counts = Counter(content.states)
    keys: list[Line2D | Patch] = [
        Patch(facecolor=colors[i % len(colors)], edgecolor=MUTED, label=f"{name}: {counts[i]}")
        for i, name in enumerate(content.names)
        if counts[i] or len(content.names) == 2
    ]
    if counts[None]:
        keys.append(Patch(facecolor=BAD, edgecolor=MUTED, label=f"invalid: {counts[None]}"))
    _draw_legend(axes, keys)
