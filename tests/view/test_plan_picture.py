"""Pictures of plans."""

from __future__ import annotations

from functools import cache

import numpy as np
from matplotlib.colors import to_hex

from colony.nav.maps.building import Building, load_building
from colony.nav.plan.plan import Plan
from colony.nav.plan.route import plan
from colony.view.map_picture import draw_plan, encode_picture
from tests.paths import MAPS


@cache
def building(name: str) -> Building:
    return load_building(MAPS / f"{name}.stickrep")


def way_drawn(name: str, planned: Plan, floor: int = 0) -> list[tuple[str, float]]:
    """The color and length of each thick line, in the order in which they are drawn."""
    axes = draw_plan(building(name).maps[floor], planned).axes[0]
    lines = [line for line in axes.lines if line.get_zorder() == 4.5]
    found = []
    for line in lines:
        x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        found.append((to_hex(line.get_color()), float(np.hypot(np.diff(x), np.diff(y)).sum())))
    return found


def test_each_segment_is_drawn_in_the_color_of_its_mode() -> None:
    planned = plan(building("loop"), "201", "216")
    drawn = way_drawn("loop", planned)
    assert [length for _, length in drawn] == [s.length_mm for s in planned.segments]
    assert len({color for color, _ in drawn}) == len({s.kind for s in planned.segments})


def test_letters_and_lights() -> None:
    planned = plan(building("loop"), "201", "216")
    axes = draw_plan(building("loop").maps[0], planned).axes[0]
    letters = [text.get_text() for text in axes.texts if text.get_zorder() == 7]
    assert letters == [chr(s.kind) for s in planned.segments if s.length_mm > 1400.0]
    rings = [line for line in axes.lines if line.get_markersize() == 9 and line.get_zorder() == 5]
    assert len(rings) == sum(len(s.lights_mm) for s in planned.segments) > 0


def test_of_two_floors_each_has_its_part() -> None:
    planned = plan(building("msu_engineering_3"), "372R", "2:264L")
    upper = way_drawn("msu_engineering_3", planned)
    lower = way_drawn("msu_engineering_3", planned, floor=1)
    assert len(upper) + len(lower) == len(planned.segments) - 1
    assert upper
    assert lower


def test_a_picture_can_be_written() -> None:
    planned = plan(building("hallway"), "101", "105")
    picture = encode_picture(draw_plan(building("hallway").maps[0], planned, title="to 105"), "svg")
    assert b"<svg" in picture
