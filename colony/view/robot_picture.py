"""Pictures of robots: the footprint from near, and the fields of view of the sensors as far as they reach."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch, Rectangle
from matplotlib.patches import Polygon as PolygonPatch

from colony.view.polar import label_bearing, point, scale_of
from colony.view.robot_scene import RobotScene, SensorView
from colony.view.sheet import FAINT, FLOOR, INK, MUTED, PAPER, SERIES

_PANEL_INCHES, _MARGIN_INCHES = 5.2, 0.25
_TITLE_INCHES, _HEADING_INCHES, _LINE_INCHES = 0.6, 0.35, 0.22
_DPI = 150
_NEAR = 1.7
"""Half the width of the picture from near, in radii of the robot."""
_REACH = 1.16
"""Half the width of the picture of the fields of view, in radii of the outermost ring."""
_MAX_EDGES = 60
"""Maximum number of elements whose fields of view are drawn with their edges."""
_WHEEL = (0.28, 0.09)
"""Length and width of a wheel, in radii of the robot."""


def draw_robot(scene: RobotScene) -> Figure:
    """Draw a robot: from near on the left, with the reach of its sensors on the right."""
    legend = _LINE_INCHES * (len(scene.sensors) + len(scene.lines)) + _MARGIN_INCHES
    width = 2 * _PANEL_INCHES + 3 * _MARGIN_INCHES
    height = _TITLE_INCHES + _HEADING_INCHES + _PANEL_INCHES + legend
    figure = Figure(figsize=(width, height), dpi=_DPI, facecolor=PAPER)
    for i, (heading, draw) in enumerate((("body", _draw_near), ("fields of view", _draw_far))):
        left = _MARGIN_INCHES + i * (_PANEL_INCHES + _MARGIN_INCHES)
        axes = figure.add_axes((left / width, legend / height, _PANEL_INCHES / width, _PANEL_INCHES / height))
        axes.axis("off")
        draw(axes, scene)
        figure.text(
            (left + _PANEL_INCHES / 2) / width, (legend + _PANEL_INCHES + 0.15) / height, heading,
            fontsize=11, weight="bold", color=INK, ha="center", va="center",
        )  # fmt: skip
    figure.text(
        _MARGIN_INCHES / width, 1 - 0.3 / height, scene.title,
        fontsize=13, weight="bold", color=INK, va="center", parse_math=False,
    )  # fmt: skip
    _draw_legend(figure, scene, width, height)
    return figure


def _draw_legend(figure: Figure, scene: RobotScene, width: float, height: float) -> None:
    """Write a line for each sensor, in its color, and the other lines below them."""
    texts = [(f"{sensor.name}: {sensor.note}", _color(i)) for i, sensor in enumerate(scene.sensors)]
    for i, (text, color) in enumerate([*texts, *((line, None) for line in scene.lines)]):
        number = len(scene.sensors) + len(scene.lines) - i - 0.5
        y = (number * _LINE_INCHES + _MARGIN_INCHES / 2) / height
        if color is not None:
            swatch = Rectangle(
                (_MARGIN_INCHES / width, y - 0.06 / height), 0.2 / width, 0.12 / height,
                facecolor=color, edgecolor="none", transform=figure.transFigure,
            )  # fmt: skip
            figure.add_artist(swatch)
        figure.text(0.55 / width, y, text, fontsize=9.5, color=INK, va="center", parse_math=False)


def _color(i: int) -> str:
    return SERIES[i % len(SERIES)]


# --- panels --------------------------------------------------------------------------------------


def _draw_near(axes: Axes, scene: RobotScene) -> None:
    """Draw the footprint, the wheels, and where the elements begin."""
    side = _NEAR * scene.radius_mm
    axes.set_xlim(-side, side)
    axes.set_ylim(-side, side)
    floor = axes.add_patch(Circle((0.0, 0.0), side, facecolor=FLOOR, edgecolor="none", zorder=0))
    _draw_hull(axes, scene)
    length, thickness = (part * scene.radius_mm for part in _WHEEL)
    for wheel in scene.wheels:
        right = point(wheel.bearing_deg - 90.0, thickness / 2)
        ahead = point(wheel.bearing_deg, length / 2)
        corners = [
            (wheel.place.x + i * right.x + j * ahead.x, wheel.place.y + i * right.y + j * ahead.y)
            for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
        axes.add_patch(PolygonPatch(corners, facecolor=MUTED, edgecolor="none", zorder=3))
    for i, sensor in enumerate(scene.sensors):
        _draw_beams(axes, sensor, _color(i), 1.5 * side, floor, alpha=0.13)
        places = list(dict.fromkeys(beam.origin for beam in sensor.beams))
        size = 4.5 if len(places) == 1 else 3.0
        axes.plot(
            [p.x for p in places],
            [p.y for p in places],
            "o",
            color=_color(i),
            markersize=size,
            zorder=6 - i / 100,
        )
    _draw_measure(axes, scene, side)


def _draw_measure(axes: Axes, scene: RobotScene, side: float) -> None:
    """Draw a line as long as the robot is wide, with its length."""
    low, high = min(p.x for p in scene.footprint), max(p.x for p in scene.footprint)
    y = -0.9 * side
    axes.add_collection(LineCollection([[(low, y), (high, y)]], colors=INK, linewidths=1.0, zorder=7))
    axes.text(
        (low + high) / 2, y + 0.05 * side, f"{high - low:.0f} mm",
        fontsize=8.5, color=INK, ha="center", zorder=8,
        bbox={"facecolor": FLOOR, "edgecolor": "none", "alpha": 0.8, "pad": 1.0},
    )  # fmt: skip


def _draw_far(axes: Axes, scene: RobotScene) -> None:
    """Draw the fields of view, with rings in meters."""
    scale = scale_of([scene.farthest_mm / 1000.0])
    outer = scale.high * 1000.0
    axes.set_xlim(-_REACH * outer, _REACH * outer)
    axes.set_ylim(-_REACH * outer, _REACH * outer)
    floor = axes.add_patch(Circle((0.0, 0.0), outer, facecolor=FLOOR, edgecolor="none", zorder=0))
    spokes = [[point(b, 0.0), point(b, outer)] for b in range(-180, 180, 45)]
    axes.add_collection(LineCollection(spokes, colors=FAINT, linewidths=0.7, zorder=1))
    for bearing in range(-135, 181, 45):
        place = point(bearing, 1.09 * outer)
        axes.text(*place, f"{bearing}°", fontsize=8, color=MUTED, ha="center", va="center")
    beside = label_bearing([], None)
    for value in scale.rings:
        ring = Circle((0.0, 0.0), value * 1000.0, facecolor="none", edgecolor=FAINT, linewidth=0.8, zorder=1)
        axes.add_patch(ring)
        axes.text(
            *point(beside, value * 1000.0), f"{value:g} m", fontsize=8, color=INK, ha="center", va="center",
            zorder=7, bbox={"facecolor": FLOOR, "edgecolor": "none", "alpha": 0.8, "pad": 1.0},
        )  # fmt: skip
    for i, sensor in enumerate(scene.sensors):
        _draw_beams(axes, sensor, _color(i), 1.5 * outer, floor, alpha=0.16)
    _draw_hull(axes, scene)


def _draw_hull(axes: Axes, scene: RobotScene) -> None:
    """Draw the footprint, with an arrow ahead."""
    axes.add_patch(
        PolygonPatch(
            list(scene.footprint), facecolor=PAPER, edgecolor=INK, linewidth=1.2, alpha=0.9, zorder=2.5
        )
    )
    tip, back = 0.3 * scene.radius_mm, -0.15 * scene.radius_mm
    arrow = [(0.0, tip), (-0.13 * scene.radius_mm, back), (0.13 * scene.radius_mm, back)]
    axes.add_patch(PolygonPatch(arrow, facecolor=INK, edgecolor="none", zorder=4))


def _draw_beams(
    axes: Axes, sensor: SensorView, color: str, farthest: float, floor: Patch, *, alpha: float
) -> None:
    """Draw the fields of view of a sensor, as far as the floor reaches; those without a width are lines."""
    wide = [beam.outline(farthest) for beam in sensor.beams if beam.sector.width > 0.0]
    thin = [beam.outline(farthest)[:2] for beam in sensor.beams if beam.sector.width <= 0.0]
    collections = [
        PolyCollection(wide, facecolors=color, edgecolors="none", alpha=alpha, zorder=2),
        LineCollection(thin, colors=color, linewidths=1.2, alpha=0.9, zorder=3.5),
    ]
    if len(wide) <= _MAX_EDGES:
        edges = PolyCollection(wide, facecolors="none", edgecolors=color, alpha=0.5, linewidths=0.5, zorder=2)
        collections.append(edges)
    for collection in collections:
        axes.add_collection(collection)
        collection.set_clip_path(floor)
