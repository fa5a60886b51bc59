"""People who walk between random free places, and free places for robots."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from colony.nav.maps.free_space import FreeSpace, NoRoomError
from colony.nav.maps.world_map import WorldMap, load_world
from colony.sim.hazards.scenery import PERSON_RADIUS_MM, bare_scenery
from colony.sim.world.movers import free_pose, movers, with_movers
from colony.sim.world.world import World
from tests.paths import MAPS
from tests.sim.robots import IDEAL, pass_time

LOOP, OFFICE = load_world(MAPS / "loop.stickrep"), load_world(MAPS / "office.yaml")
MAPS_OF_BOTH_KINDS = pytest.mark.parametrize("world_map", [LOOP, OFFICE], ids=["loop", "office"])


def populated(world_map: WorldMap, people: int, seed: int) -> World:
    """A world with people, and a robot at the start of its map."""
    pose = world_map.start(IDEAL.radius_mm)
    bare = bare_scenery(world_map.walls, seed=seed)
    scenery = with_movers(bare, lambda: FreeSpace(world_map), pose[:2], people, seed=seed)
    return World(walls=scenery, poses=[pose], config=IDEAL, seed=seed)


@MAPS_OF_BOTH_KINDS
def test_people_walk_and_never_through_walls(world_map: WorldMap) -> None:
    world = populated(world_map, 8, seed=3)
    first = world.people
    walked = np.zeros(len(first))
    walls = world.walls
    for _ in range(600):
        before = world.people
        world.advance(0.1)
        walked += np.hypot(*(world.people - before).T)
        for person in world.people:
            start = walls[:, :2] - person
            part = np.clip(-(start * walls[:, 4:6]).sum(axis=1), 0.0, walls[:, 6])
            gaps = np.hypot(*(start + part[:, None] * walls[:, 4:6]).T)
            assert gaps.min() >= PERSON_RADIUS_MM
    assert len(first) == 8
    assert np.median(walked) > 20_000.0


@MAPS_OF_BOTH_KINDS
def test_a_seed_gives_the_same_people_and_a_number_of_them_the_first(world_map: WorldMap) -> None:
    space, start = FreeSpace(world_map), world_map.start(300.0)[:2]
    five = movers(space, start, 5, seed=7)
    assert five == movers(FreeSpace(world_map), start, 5, seed=7)
    assert five[:2] == movers(space, start, 2, seed=7)
    assert five != movers(space, start, 5, seed=8)
    assert len({person.track for person in five}) == 5


def test_nobody_bumps_into_a_robot_that_stands_still() -> None:
    world = populated(LOOP, 20, seed=5)
    pass_time(world, 60.0)
    assert world.bumps(0) == 0


def test_no_movers_leave_a_scenery_as_it_is() -> None:
    scenery = bare_scenery(LOOP.walls)
    assert with_movers(scenery, lambda: pytest.fail("not needed"), (0.0, 0.0), 0, seed=1) is scenery


def test_people_join_those_of_a_scenery() -> None:
    start = LOOP.start(300.0)[:2]
    first = movers(FreeSpace(LOOP), start, 2, seed=1)
    scenery = replace(bare_scenery(LOOP.walls), people=first)
    more = with_movers(scenery, lambda: FreeSpace(LOOP), start, 3, seed=2)
    assert more.people == (*first, *movers(FreeSpace(LOOP), start, 3, seed=2))


@MAPS_OF_BOTH_KINDS
def test_free_poses_keep_apart(world_map: WorldMap) -> None:
    space, start = FreeSpace(world_map), world_map.start(400.0)[:2]
    taken = [(start, 400.0)]
    for number in range(1, 5):
        x, y, heading = free_pose(space, start, 300.0, taken, number=number, seed=9)
        assert all(math.dist((x, y), at) >= 300.0 + radius + 1_000.0 for at, radius in taken)
        assert 0.0 <= heading < 360.0
        taken.append(((x, y), 300.0))
    poses = [(*at, 0.0) for at, _ in taken]
    World(
        walls=world_map.walls, poses=poses, config=[replace(IDEAL, radius_mm=r, ring=None) for _, r in taken]
    )


def test_a_full_map_has_no_free_pose() -> None:
    start = LOOP.start(400.0)[:2]
    with pytest.raises(NoRoomError, match="no free place for a robot with a radius of 300 mm"):
        free_pose(FreeSpace(LOOP), start, 300.0, [(start, 1e6)], number=1, seed=1)
