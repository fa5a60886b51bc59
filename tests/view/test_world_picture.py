"""Pictures of worlds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from colony.nav.maps.stickrep.model import Pose
from colony.nav.maps.world_map import load_world, world_of_grid
from colony.view.map_picture import draw_world, encode_picture
from tests.nav.maps.grid.small_grids import grid_of
from tests.paths import MAPS

PATH = np.array([[0.0, 0.0], [100.0, 50.0], [np.nan, 0.0]])


def test_a_grid_shows_its_cells_its_walls_and_the_path() -> None:
    world = world_of_grid(grid_of("####\n#.?#\n####", x_mm=-70.0, yaw_deg=30.0))
    figure = draw_world(world, [PATH], names=["amr"])
    axes = figure.axes[0]
    [cells] = axes.images
    assert np.asarray(cells.get_array()).tolist() == [[1, 1, 1, 1], [1, 0, 2, 1], [1, 1, 1, 1]]
    corner = cells.get_transform().transform((4.0, 3.0)) - axes.transData.transform((0.0, 0.0))
    place = axes.transData.transform(world.walls[:, :2]) - axes.transData.transform((0.0, 0.0))
    assert np.hypot(*(place - corner).T).min() < 1e-6
    [walls] = [c for c in axes.collections if c.get_label() == "wall"]
    assert [s.tolist() for s in walls.get_segments()] == world.walls.reshape(-1, 2, 2).tolist()
    legend = [text.get_text() for text in axes.get_legend().get_texts()]
    assert legend == ["wall", "occupied", "unknown", "amr (○ start, ■ end)"]


def test_a_grid_without_a_path_shows_the_start() -> None:
    world = load_world(MAPS / "office.yaml")
    figure = draw_world(world, start=world.start(400.0))
    assert "start" in [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert encode_picture(figure, "png").startswith(b"\x89PNG")


def test_the_docks_of_a_grid_are_drawn() -> None:
    world = replace(world_of_grid(grid_of("...\n...")), docks=(Pose(60.0, 60.0, 90.0),))
    axes = draw_world(world).axes[0]
    [dock] = [line for line in axes.lines if line.get_label() == "dock"]
    assert np.array(dock.get_xydata()).tolist() == [[60.0, 60.0]]


def test_a_building_looks_as_its_map() -> None:
    figure = draw_world(load_world(MAPS / "loop.stickrep"), [PATH])
    assert "door" in [text.get_text() for text in figure.axes[0].get_legend().get_texts()]


def test_people_are_drawn_below_the_robots_with_one_line_in_the_legend() -> None:
    walks = [np.array([[1000.0, 1000.0], [5000.0, 1000.0]]), np.array([[2000.0, 1500.0], [2000.0, 1500.0]])]
    for name in ("loop.stickrep", "office.yaml"):
        axes = draw_world(load_world(MAPS / name), [PATH], names=["amr"], people=walks).axes[0]
        assert axes.get_legend_handles_labels()[1].count("people") == 1
        [ends] = [line for line in axes.lines if line.get_label() == "people"]
        assert ends.get_xydata().tolist() == [[5000.0, 1000.0], [2000.0, 1500.0]]
