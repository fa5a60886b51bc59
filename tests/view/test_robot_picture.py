"""Pictures of robots, as drawn."""

from __future__ import annotations

import pytest
from matplotlib.collections import LineCollection, PolyCollection

from colony.view.map_picture import encode_picture
from colony.view.robot_picture import draw_robot
from colony.view.sheet import SERIES
from tests.view.test_robot_scene import rome, scene


def test_both_panels_show_each_sensor_in_its_color() -> None:
    figure = draw_robot(rome())
    near, far = figure.axes
    for axes in (near, far):
        wide = [c for c in axes.collections if isinstance(c, PolyCollection) and len(c.get_paths())]
        assert [len(c.get_paths()) for c in wide] == [24, 24, 1, 1, 1, 1]  # filled, and their edges
        lines = [c for c in axes.collections if isinstance(c, LineCollection) and len(c.get_paths()) == 24]
        assert len(lines) == 1  # the infrared detectors have no width
    texts = [text.get_text() for text in figure.texts]
    assert texts == [
        "body",
        "fields of view",
        "rome",
        "sonar: 24 elements, 10 m",
        "infrared: 24 elements, 0.76 m",
        "CServerSide: camera, 60°",
        "CServerFront: camera, 60°",
        "looks up: CServerUp",
    ]
    assert len(figure.artists) == 4 <= len(SERIES)
    assert {"2 m", "10 m", "0°", "90°"} <= {text.get_text() for text in far.texts}
    assert "800 mm" in {text.get_text() for text in near.texts}


def test_many_elements_have_no_edges() -> None:
    near, _ = draw_robot(scene()).axes
    assert len([c for c in near.collections if isinstance(c, PolyCollection)]) == 1


@pytest.mark.parametrize("format_", ["png", "svg"])
def test_any_robot_is_drawn(format_: str) -> None:
    assert format_ in ("png", "svg")
    bare = scene("robot small { sensor bumper : bool from RServer.bumper }")
    for drawn in (rome(), scene(), bare):
        assert encode_picture(draw_robot(drawn), "png" if format_ == "png" else "svg")
