"""Free space of maps: where disks can move, and random ways through it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from colony.nav.maps.free_space import FreeSpace, NoRoomError, Place
from colony.nav.maps.grid.model import GridCell
from colony.nav.maps.stickrep.geometry import corners, in_free_space
from colony.nav.maps.stickrep.model import Map
from colony.nav.maps.world_map import WorldMap, load_world, world_of_grid
from tests.nav.maps.grid.small_grids import grid_of
from tests.paths import MAPS

LOOP = load_world(MAPS / "loop.stickrep")
OFFICE = load_world(MAPS / "office.yaml")
HALL = world_of_grid(
    grid_of(
        "\n".join(
            ["#" * 40]
            + ["#" + "." * 20 + "#" + "." * 17 + "#"] * 12
            + ["#" + "." * 20 + "?" + "." * 17 + "#"] * 8
            + ["#" * 40]
        ),
        cell_mm=100.0,
    )
)
"""Two rooms of 2 m and 1.7 m, side by side, with a wall and cells that are unknown between them."""


def start_of(world: WorldMap) -> Place:
    return world.start(300.0)[:2]


def nearest_wall_mm(world: WorldMap, start: Place, end: Place) -> float:
    """The distance of the nearest wall from a leg, by many points on it."""
    nearest = math.inf
    for x, y in np.linspace(start, end, 200):
        a, along = world.walls[:, :2] - (x, y), world.walls[:, 2:] - world.walls[:, :2]
        part = np.clip(-(a * along).sum(axis=1) / (along * along).sum(axis=1), 0.0, 1.0)
        nearest = min(nearest, float(np.hypot(*(a + part[:, None] * along).T).min()))
    return nearest


def test_a_disk_moves_where_it_keeps_its_radius_from_every_wall() -> None:
    space = FreeSpace(LOOP)
    x, y = start_of(LOOP)
    room = nearest_wall_mm(LOOP, (x, y), (x, y))
    assert space.is_free((x, y), (x, y), room - 1.0)
    assert not space.is_free((x, y), (x, y), room + 1.0)
    assert not space.is_free((x, y), (x, y + 10_000.0), 1.0)  # across the block in the middle


def test_nothing_moves_through_cells_that_are_unknown() -> None:
    space = FreeSpace(HALL)
    assert space.is_free((500.0, 500.0), (1_500.0, 500.0), 200.0)
    assert not space.is_free((500.0, 500.0), (3_000.0, 500.0), 200.0)  # unknown
    assert not space.is_free((500.0, 1_500.0), (3_000.0, 1_500.0), 200.0)  # a wall
    assert not space.is_free((500.0, 500.0), (-5_000.0, 500.0), 200.0)  # beyond the image


def test_holes_are_not_free() -> None:
    hole = np.array([[1_000.0, 1_000.0], [2_000.0, 1_000.0], [2_000.0, 2_000.0], [1_000.0, 2_000.0]])
    holed = WorldMap(name="holed", walls=np.empty((0, 4)), holes=(hole,), source=LOOP.source)
    space = FreeSpace(holed)
    assert space.is_free((0.0, 0.0), (3_000.0, 0.0), 900.0)
    assert not space.is_free((0.0, 0.0), (3_000.0, 3_000.0), 1.0)


@pytest.mark.parametrize("world", [LOOP, OFFICE], ids=["loop", "office"])
def test_random_legs_are_free_and_can_be_reached(world: WorldMap) -> None:
    space, ends = FreeSpace(world), set()
    for seed in range(6):
        print("seed", seed)
        start, end = space.random_leg(start_of(world), 400.0, np.random.default_rng(seed))
        again = space.random_leg(start_of(world), 400.0, np.random.default_rng(seed))
        assert (start, end) == again
        assert nearest_wall_mm(world, start, end) >= 400.0
        if isinstance(world.source, Map):
            outlines = tuple(corners(ring) for ring in world.source.rings)
            assert in_free_space(outlines, *end)
        else:
            column, row = np.floor(world.source.to_cells(np.array(end))).astype(int)
            assert world.source.cells[row, column] == GridCell.FREE
        ends.add(end)
    assert len(ends) == 6
    assert max(math.dist(a, b) for a in ends for b in ends) > 3_000.0


def test_legs_stay_in_the_room_where_they_begin() -> None:
    space = FreeSpace(HALL)
    for seed in range(5):
        print("seed", seed)
        for x, y in space.random_leg((500.0, 500.0), 200.0, np.random.default_rng(seed)):
            assert 0.0 < x < 2_100.0
            assert 0.0 < y < 2_100.0


def test_ways_begin_beside_a_start_that_is_too_near_to_a_wall() -> None:
    start, _ = FreeSpace(HALL).random_leg((350.0, 500.0), 400.0, np.random.default_rng(1))
    assert FreeSpace(HALL).is_free(start, start, 400.0)


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(NoRoomError, match="nothing with a radius of 5000 mm can move away from"):
        FreeSpace(LOOP).random_leg(start_of(LOOP), 5_000.0, np.random.default_rng(1))
