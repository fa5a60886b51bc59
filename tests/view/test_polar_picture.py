"""Polar pictures, as drawn."""

from __future__ import annotations

import math
from dataclasses import replace

from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from colony.ir.bearings import listed_bearings, uniform
from colony.view.map_picture import encode_picture
from colony.view.polar import scale_of
from colony.view.polar_picture import DiscreteValues, Mark, Panel, PolarScene, Ranges, draw_scene

MARKS: tuple[Mark, ...] = ("reading", "limit", "infinite", "negative", "invalid")


def ranges_panel(size: int = 5, marks: tuple[Mark, ...] = MARKS) -> Panel:
    bearings = uniform(-40, 20 if size == 5 else 80 / size, size)
    assert bearings is not None
    values = (3.0, 10.0, math.inf, -1.0, math.nan) if size == 5 else (2.0,) * size
    content = Ranges(values=values, marks=marks, unit="m", scale=scale_of([3.5]), limit=10.0)
    return Panel(name="scan", bearings=bearings, content=content, notes=("a note",))


def state_panel() -> Panel:
    bearings = listed_bearings([0, 90, 0])
    content = DiscreteValues(states=(1, 0, None), names=("false", "true"))
    return Panel(name="bumper", bearings=bearings, content=content, notes=())


def missing_panel() -> Panel:
    return Panel(name="gone", bearings=listed_bearings([0, 90]), content=None, notes=())


def scene(*panels: Panel, title: str = "$t$") -> PolarScene:
    return PolarScene(title=title, panels=panels, lines=("drive by a", "active: " + "module, " * 40))


def texts(axes: Axes) -> list[str]:
    legend = axes.get_legend()
    keys = [] if legend is None else [text.get_text() for text in legend.get_texts()]
    return [text.get_text() for text in axes.texts] + keys


def test_each_mark_has_its_place_and_its_key() -> None:
    [axes] = draw_scene(scene(ranges_panel())).axes
    places = {
        (line.get_marker(), round(math.hypot(float(x[0]), float(y[0])), 3))
        for line in axes.lines
        for x, y in [line.get_data()]
        if len(x)
    }
    assert places == {("o", 0.75), ("o", 1.0), ("^", 1.04), ("v", 0.07), ("X", 1.04), ((3, 0, 0), 0.0)}
    keys = ["reading: 1", "10 m or more: 1", "infinite: 1", "negative: 1", "invalid: 1"]
    assert texts(axes)[-5:] == keys
    assert {"1 m", "4 m", "0°", "180°", "-45°"} <= set(texts(axes))


def test_notes_end_above_the_panel() -> None:
    notes = ("arc of 5", "nearest 3 m at -40 deg", "the program takes it as missing")
    figure = draw_scene(scene(replace(ranges_panel(), notes=notes)))
    lowest = min(text.get_position()[1] for text in figure.texts if text.get_text() in notes)
    assert lowest > figure.axes[0].get_position().y1


def test_the_sector_where_nothing_looks_is_shaded() -> None:
    [axes] = draw_scene(scene(ranges_panel())).axes
    first = next(c for c in axes.collections if isinstance(c, PolyCollection))
    corners = first.get_paths()[0].vertices
    assert float(min(y for _, y in corners)) < -0.99  # behind the robot


def test_sectors_along_one_bearing_do_not_cover_each_other() -> None:
    [axes] = draw_scene(scene(state_panel())).axes
    sectors = next(c for c in axes.collections if isinstance(c, PolyCollection) and len(c.get_paths()) == 3)
    reach = [
        (round(min(radii), 3), round(max(radii), 3))
        for path in sectors.get_paths()
        for radii in [[math.hypot(x, y) for x, y in path.vertices]]
    ]
    assert reach == [(0.35, 0.675), (0.35, 1.0), (0.675, 1.0)]
    assert len({tuple(color) for color in sectors.get_facecolor()}) == 3
    assert texts(axes)[-3:] == ["false: 1", "true: 1", "invalid: 1"]


def test_arrays_are_side_by_side_and_pictures_repeat() -> None:
    panels = (ranges_panel(), state_panel(), missing_panel(), state_panel())
    figure = draw_scene(scene(*panels))
    boxes = [axes.get_position() for axes in figure.axes]
    assert [round(box.y0, 3) for box in boxes[:3]] == [round(boxes[0].y0, 3)] * 3
    assert boxes[3].y1 < boxes[0].y0
    assert "missing" in texts(figure.axes[2])
    drawn = encode_picture(figure, "svg")
    assert drawn.startswith(b"<?xml")
    assert drawn == encode_picture(draw_scene(scene(*panels)), "svg")


def test_a_lidar_of_4096_beams_is_drawn() -> None:
    figure = draw_scene(scene(ranges_panel(4096, ("reading",) * 4096)))
    assert encode_picture(figure, "png").startswith(b"\x89PNG")
