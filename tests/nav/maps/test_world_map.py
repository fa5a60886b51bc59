"""Worlds of StickRep maps."""

from __future__ import annotations

import numpy as np

from colony.nav.maps.stickrep.reader import load_map
from colony.nav.maps.walls import walls_of
from colony.nav.maps.world_map import load_world
from tests.paths import MAPS


def test_a_stickrep_map_is_a_world() -> None:
    path = MAPS / "loop.stickrep"
    world, source = load_world(path), load_map(path)
    assert (world.name, world.start(300.0), world.source) == ("loop", source.start, source)
    assert np.array_equal(world.walls, walls_of(source).segments)
    assert [hole.tolist() for hole in world.holes] == [
        [list(corner) for corner in hole.corners()] for hole in source.holes
    ]


def test_the_default_start_of_a_building_is_that_of_its_map() -> None:
    world = load_world(MAPS / "loop.stickrep")
    assert world.start(1e6, (1.0, 2.0, 3.0)) == (1.0, 2.0, 3.0)
    assert world.building("a camera") is world.source
    assert world.files == (str(MAPS / "loop.stickrep"),)
