"""The path of a robot over days: bounded, with both of its ends, and true to the shape; and off the map."""

from __future__ import annotations

import math

from colony.nav.maps.driven_path import SPACING_MM, DrivenPath, MapExit
from colony.nav.maps.world_map import load_world, world_of_grid
from colony.runtime.observe.summary import OffMap
from tests.nav.maps.grid.small_grids import grid_of
from tests.paths import MAPS


def test_a_short_path_has_its_first_and_its_newest_place() -> None:
    path = DrivenPath()
    for x in range(1000):
        path.add(float(x), 0.0)
    assert path.points[0] == (0.0, 0.0)
    assert path.points[-1] == (999.0, 0.0)
    assert all(math.dist(a, b) <= 2 * SPACING_MM for a, b in zip(path.points, path.points[1:], strict=False))


def test_a_robot_that_stands_adds_nothing() -> None:
    path = DrivenPath()
    for _ in range(1000):
        path.add(5.0, 5.0)
    assert path.points == [(5.0, 5.0), (5.0, 5.0)]


def test_a_long_path_stays_bounded_and_evenly_spaced() -> None:
    path = DrivenPath(max_points=100)
    for step in range(200_000):
        path.add(7.0 * step, 0.0)
        assert len(path.points) <= 100
    assert path.points[0] == (0.0, 0.0)
    assert path.points[-1] == (7.0 * 199_999, 0.0)
    gaps = [b[0] - a[0] for a, b in zip(path.points, path.points[1:], strict=False)]
    assert len(gaps) > 25
    assert max(gaps) < 0.1 * path.points[-1][0]


def test_a_robot_that_leaves_the_known_cells_and_the_image_is_noticed() -> None:
    map_exit = MapExit(world_of_grid(grid_of("..??", cell_mm=1000.0)))
    found = []
    for t_s, x_mm in enumerate([500.0, 1500.0, 2500.0, 1500.0, 3500.0, 4500.0, 500.0, -500.0]):
        map_exit.add(float(t_s), x_mm, 500.0)
        found.append(map_exit.off_map)
    assert found == [
        None,
        None,
        OffMap(left_known_s=2.0, left_image_s=None, seconds=0.0),
        OffMap(left_known_s=2.0, left_image_s=None, seconds=0.0),
        OffMap(left_known_s=2.0, left_image_s=None, seconds=1.0),
        OffMap(left_known_s=2.0, left_image_s=5.0, seconds=2.0),
        OffMap(left_known_s=2.0, left_image_s=5.0, seconds=2.0),
        OffMap(left_known_s=2.0, left_image_s=5.0, seconds=3.0),
    ]


def test_a_building_has_no_cells_to_leave() -> None:
    map_exit = MapExit(load_world(MAPS / "loop.stickrep"))
    map_exit.add(1.0, -1e6, 0.0)
    assert map_exit.off_map is None
