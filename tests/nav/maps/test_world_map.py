"""Worlds of StickRep maps."""

from __future__ import annotations

import numpy as np
import pytest

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


@pytest.mark.parametrize("place", [(-50_000.0, -50_000.0), (5_000.0, 5_000.0), (1e300, 0.0)])
def test_no_start_is_outside_of_a_building_or_in_a_block(place: tuple[float, float]) -> None:
    world = load_world(MAPS / "loop.stickrep")
    with pytest.raises(ValueError, match=r"is not in free space; expected a place inside an outline"):
        world.start(1.0, (*place, 90.0))
