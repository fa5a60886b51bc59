"""Polar pictures: the readings of arrays with bearings around the robot, and what was decided.

Ahead is up, and 90 degrees is left. Ranges are drawn from the robot's center, wherever the sensors are on it.
"""

from __future__ import annotations

import math
import textwrap
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, Literal, assert_never

from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from colony.ir.bearings import Bearings, index_text
from colony.ir.frame import Frame, Reading
from colony.ir.program import Program, Sensor
from colony.ir.types import DISTANCE, Array, Bool, Enum, Quantity, bearings_of
from colony.view.polar import (
    RadialScale,
    Sector,
    blind_sector,
    label_bearing,
    layers,
    outline,
    point,
    scale_of,
    sectors,
)
from colony.view.sheet import BAD, FAINT, FLOOR, GOOD, INK, MUTED, PAPER, SERIES

# --- frame scene --------------------------------------------------------------------------------------
#
# What a polar picture of a frame shows, as data: a panel for each array with bearings, and the decisions.

Mark = Literal["reading", "limit", "infinite", "negative", "invalid"]
"""Kind of an element: a reading; one at the upper end of the sensor's range, such as a sonar without echo; an
infinite one; a negative distance; or none that the language knows, such as NaN."""

_MM_PER_M = 1000.0
_MAX_NAMED = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Ranges:
    """Quantities in `unit`, each with its mark; `limit` is the upper end of the range."""

    values: tuple[float, ...]
    marks: tuple[Mark, ...]
    unit: str
    scale: RadialScale
    limit: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscreteValues:
    """Bools or enumerators: the index in `names` of each element, None for an invalid one."""

    states: tuple[int | None, ...]
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """An array with bearings; `content` is None if it was not read. `notes` are lines below its name."""

    name: str
    bearings: Bearings
    content: Ranges | DiscreteValues | None
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PolarScene:
    """A frame: a panel for each array with bearings, and lines about decisions."""

    title: str
    panels: tuple[Panel, ...]
    lines: tuple[str, ...]


def arrays_with_bearings(program: Program) -> tuple[Sensor, ...]:
    """Return the sensors that are arrays with bearings."""
    return tuple(s for s in program.robot.sensors if bearings_of(s.type) is not None)


def scene_of(
    program: Program, title: str, frame: Frame, read: Collection[str], lines: Sequence[str]
) -> PolarScene:
    """Return the scene of a frame.

    Args:
        program: The program that decided.
        title: What the picture is called.
        frame: The frame, in declared units.
        read: The sensors that the program does not take as missing.
        lines: Lines about the decisions.
    """
    panels = (_panel(s, frame.readings.get(s.name), s.name in read) for s in arrays_with_bearings(program))
    return PolarScene(title=title, panels=tuple(panels), lines=tuple(lines))


def _panel(sensor: Sensor, reading: Reading, is_read: bool) -> Panel:
    assert isinstance(sensor.type, Array)
    bearings, content = sensor.type.bearings, _content(sensor, sensor.type, reading)
    assert bearings is not None
    notes = [describe(bearings)]
    if content is not None:
        notes += _summary(bearings, content)
    if content is not None and not is_read:
        notes.append("the program takes it as missing")
    return Panel(name=sensor.name, bearings=bearings, content=content, notes=tuple(notes))


def describe(bearings: Bearings) -> str:
    """Return `ring of 24, 15 deg apart`, `arc of 9 from -20 deg to 20 deg, 5 deg apart` or `6 directions`."""
    size = len(bearings.angles)
    if size == 1:
        return f"one element at {_degrees(bearings.angles[0])}"
    if bearings.step is None:
        return f"{size} directions"
    apart = f"{_degrees(abs(bearings.step))} apart"
    if bearings.ends is None:
        return f"ring of {size}, {apart}"
    first, last = (_degrees(bearings.angles[i]) for i in bearings.ends)
    return f"arc of {size} from {first} to {last}, {apart}"


def _degrees(angle: float) -> str:
    return f"{angle:.6g} deg"


# --- content ---------------------------------------------------------------------------------------


def _content(sensor: Sensor, type_: Array, reading: Reading) -> Ranges | DiscreteValues | None:
    if not isinstance(reading, Sequence) or isinstance(reading, str) or len(reading) != type_.size:
        return None
    match type_.element:
        case Bool():
            states = tuple(int(x) if isinstance(x, bool) else None for x in reading)
            return DiscreteValues(states=states, names=("false", "true"))
        case Enum(members=members):
            numbers = [n for _, n in members]
            indices = (numbers.index(x) if x in numbers else None for x in map(_number, reading))
            return DiscreteValues(states=tuple(indices), names=tuple(name for name, _ in members))
        case Quantity():
            return _ranges(sensor, [_number(x) for x in reading])
        case _:
            assert_never(type_.element)


def _number(value: object) -> float:
    """Return the number that was recorded, NaN for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _ranges(sensor: Sensor, readings: Sequence[float]) -> Ranges:
    assert isinstance(sensor.type, Array)
    is_length = sensor.type.element == DISTANCE
    factor, unit = (sensor.factor / _MM_PER_M, "m") if is_length else (1.0, sensor.unit)
    limit = None
    if sensor.high is not None and math.isfinite(sensor.high):
        limit = sensor.high / sensor.factor
    marks = tuple(_mark(x, limit, is_length) for x in readings)
    values = tuple(x * factor for x in readings)
    shown_limit = None if limit is None else limit * factor
    seen = [x for x, mark in zip(values, marks, strict=True) if mark == "reading"]
    beyond = abs(shown_limit) if shown_limit else 1.0
    return Ranges(
        values=values, marks=marks, unit=unit, scale=scale_of(seen, otherwise=beyond), limit=shown_limit
    )


def _mark(value: float, limit: float | None, is_length: bool) -> Mark:
    if math.isnan(value):
        return "invalid"
    if is_length and value < 0.0:
        return "negative"
    if math.isinf(value):
        return "infinite" if value > 0.0 else "invalid"
    return "limit" if limit is not None and value >= limit else "reading"


# --- summaries -----------------------------------------------------------------------------------


def _summary(bearings: Bearings, content: Ranges | DiscreteValues) -> list[str]:
    match content:
        case Ranges(values=values, marks=marks, unit=unit):
            is_length = unit == "m"
            counted = {"reading"} if is_length else {"reading", "limit"}  # a distance at the limit is no echo
            seen = [i for i, mark in enumerate(marks) if mark in counted]
            if not seen:
                return []
            word, choose = ("nearest", min) if is_length else ("highest", max)
            i = choose(seen, key=lambda k: values[k])
            return [f"{word} {quantity(values[i], unit)} at {index_text(bearings, i)}"]
        case DiscreteValues(states=states, names=("false", "true")):
            places = [index_text(bearings, i) for i, state in enumerate(states) if state]
            more = f" and {len(places) - _MAX_NAMED} more" if len(places) > _MAX_NAMED else ""
            return [f"true at {', '.join(places[:_MAX_NAMED])}{more}" if places else "true nowhere"]
        case DiscreteValues():
            return []
        case _:
            assert_never(content)


def quantity(value: float, unit: str) -> str:
    """Return a number with up to four digits, and its unit."""
    return f"{value:.4g} {unit}".rstrip()


# --- polar picture ------------------------------------------------------------------------------------

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


def draw_scene(scene: PolarScene) -> Figure:
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
        case DiscreteValues():
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


def _draw_states(axes: Axes, bearings: Bearings, content: DiscreteValues) -> None:
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
