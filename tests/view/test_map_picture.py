from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.patches import Polygon

from colony.nav.maps.stickrep.geometry import link_endpoints
from colony.nav.maps.stickrep.model import Hole, Pose
from colony.nav.maps.stickrep.reader import load_map
from colony.view.map_picture import draw_map, encode_picture, picture_format
from tests.paths import MAPS

LOOP = load_map(MAPS / "loop.stickrep")
WAY = np.array([[6_604.0, 1_270.0, 270.0], [12_000.0, 1_270.0, 270.0], [np.nan, 0.0, 0.0]])


def test_a_picture_names_corners_and_doors_and_explains_its_marks() -> None:
    figure = draw_map(LOOP, [WAY], title="a run")
    (axes,) = figure.axes
    texts = {text.get_text() for text in axes.texts}
    assert {"A", "B", "C", "D", "201", "lift", "5 m", "a run"} <= texts
    legend = axes.get_legend()
    labels = [text.get_text() for text in legend.get_texts()]
    marks = ["wall", "door", "elevator", "link", "ceiling light", "light of a turning space"]
    assert labels == [*marks, "robot (○ start, ■ end)"]


def test_a_map_alone_shows_its_start() -> None:
    legend = draw_map(LOOP).axes[0].get_legend()
    assert legend.get_texts()[-1].get_text() == "start"


def test_only_what_is_there_is_explained() -> None:
    legend = draw_map(load_map(MAPS / "hallway.stickrep")).axes[0].get_legend()
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels == ["wall", "door", "elevator", "ceiling light", "start"]


def test_links_are_drawn_between_their_places() -> None:
    [links] = [c for c in draw_map(LOOP).axes[0].collections if c.get_label() == "link"]
    assert isinstance(links, LineCollection)
    drawn = [segment.tolist() for segment in links.get_segments()]
    assert drawn == [[list(one), list(other)] for one, other in link_endpoints(LOOP)]
    assert drawn[0] == [[0.0, 0.0], [2540.0, 2540.0]]


@pytest.mark.parametrize("name", ["loop", "narrow", "atrium", "msu_engineering_2", "msu_engineering_3"])
def test_names_do_not_lie_on_each_other(name: str) -> None:
    figure = draw_map(load_map(MAPS / f"{name}.stickrep"))
    renderer = FigureCanvasAgg(figure).get_renderer()
    boxes = [text.get_window_extent(renderer) for text in figure.axes[0].texts]
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


@pytest.mark.thorough
def test_everything_is_inside_the_picture() -> None:
    for name in ("hallway", "loop", "atrium", "msu_engineering_3"):
        figure = draw_map(load_map(MAPS / f"{name}.stickrep"), [WAY] * 8)
        renderer = FigureCanvasAgg(figure).get_renderer()
        legend = figure.axes[0].get_legend()
        assert legend is not None
        for artist in (*figure.axes[0].texts, legend):
            box = artist.get_window_extent(renderer)
            assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
            assert figure.bbox.y0 <= box.y0 < box.y1 <= figure.bbox.y1


def test_a_picture_is_to_scale() -> None:
    for name in ("hallway", "narrow"):
        figure = draw_map(load_map(MAPS / f"{name}.stickrep"))
        (low_x, high_x), (low_y, high_y) = figure.axes[0].get_xlim(), figure.axes[0].get_ylim()
        width, height = figure.get_size_inches()
        assert (high_x - low_x) / width == pytest.approx((high_y - low_y) / height)


def test_svg_is_the_same_byte_for_byte() -> None:
    one, two = (encode_picture(draw_map(LOOP, [WAY]), "svg") for _ in range(2))
    assert one == two
    assert b"<svg" in one
    assert b"dc:date" not in one


def test_png() -> None:
    assert encode_picture(draw_map(LOOP), "png").startswith(b"\x89PNG")


def test_only_png_and_svg() -> None:
    assert picture_format("a/b.Svg") == "svg"
    assert picture_format("map.PNG") == "png"
    with pytest.raises(ValueError, match=r"ending in \.png or \.svg"):
        picture_format("map.pdf")


def test_paths_of_a_wrong_shape_and_empty_ones() -> None:
    with pytest.raises(ValueError, match="shape"):
        draw_map(LOOP, [np.zeros(3)])
    draw_map(LOOP, [np.full((2, 2), np.nan)])


def test_docks_are_drawn_and_explained_once() -> None:
    docks = (Pose(1000.0, 2000.0, 90.0), Pose(3000.0, 1000.0, 0.0))
    figure = draw_map(replace(LOOP, docks=docks))
    lines = [line for line in figure.axes[0].lines if line.get_color() == "#3f8f3a"]
    drawn = [np.array(line.get_xydata()).tolist() for line in lines]
    assert drawn == [[[1000.0, 2000.0]], [[3000.0, 1000.0]]]
    legend = figure.axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()].count("dock") == 1


def test_holes_are_drawn_and_explained_once() -> None:
    holes = (Hole(1000.0, 2000.0, 1500.0, 2600.0), Hole(0.0, 0.0, 300.0, 400.0))
    figure = draw_map(replace(LOOP, holes=holes))
    drawn = [patch.get_xy()[:-1].tolist() for patch in figure.axes[0].patches if isinstance(patch, Polygon)]
    assert drawn == [[list(corner) for corner in hole.corners()] for hole in holes]
    legend = figure.axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()].count("hole") == 1
