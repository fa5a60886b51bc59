"""What holds for the world as a whole: determinism, independence of robots, refusal of nonsense."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from colony.nav.maps.walls import walls_of
from colony.sim.world.world import World
from tests.buildings import LOOP
from tests.sim.robots import IDEAL, RING

WALLS = walls_of(LOOP).segments


def wander(world: World, robot: int) -> None:
    """A small behavior that makes what is sensed matter for what is done."""
    readings, bumper = world.sonar(robot), world.bumper(robot)
    if bumper.front:
        world.command(robot, -200.0, 15.0)
    elif readings[7:18].min() < 700.0:
        world.command(robot, 80.0, 40.0 if readings[13:18].min() > readings[7:12].min() else -40.0)
    else:
        world.command(robot, 400.0, 0.0)


def history(world: World, robot: int, steps: int = 200) -> list[tuple[object, ...]]:
    out: list[tuple[object, ...]] = []
    for _ in range(steps):
        for each in range(len(world)):
            wander(world, each)
        world.advance(0.1)
        out.append((world.true_pose(robot), world.odometry(robot), world.sonar(robot).tobytes()))
    return out


def test_the_same_seed_gives_the_same_run_bit_for_bit() -> None:
    first, second, other = (
        history(World(walls=WALLS, poses=[LOOP.start], seed=seed), 0) for seed in (1, 1, 2)
    )
    assert first == second
    assert first != other


def test_a_run_does_not_depend_on_which_sensors_are_read() -> None:
    read, unread = (World(walls=WALLS, poses=[LOOP.start], seed=3) for _ in range(2))
    for world in (read, unread):
        world.command(0, 300.0, 2.0)
        for _ in range(50):
            world.advance(0.1)
            if world is read:
                world.sonar(0)
                world.infrared(0)
    assert read.odometry(0) == unread.odometry(0)
    assert (read.sonar(0) == unread.sonar(0)).all()


def test_a_robot_among_others_behaves_as_it_does_alone() -> None:
    # The others are around two corners, out of sight and out of reach.
    others = [(28_500.0, 18_500.0, 0.0), (27_000.0, 18_700.0, 90.0)]
    alone = World(walls=WALLS, poses=[LOOP.start], seed=4)
    together = World(walls=WALLS, poses=[LOOP.start, *others], seed=4)
    assert history(alone, 0) == history(together, 0)


def test_robots_without_noise_do_not_depend_on_their_number() -> None:
    poses = [(1_270.0, 4_000.0, 0.0), (28_700.0, 9_000.0, 180.0), (20_000.0, 18_700.0, 90.0)]
    together = World(walls=WALLS, poses=poses, config=IDEAL)
    for i, pose in enumerate(poses):
        assert (World(walls=WALLS, poses=[pose], config=IDEAL).sonar(0) == together.sonar(i)).all()


def test_readings_belong_to_the_caller() -> None:
    world = World(walls=WALLS, poses=[LOOP.start])
    before = world.sonar(0)
    world.sonar(0)[:] = 0.0
    world.infrared(0)[:] = True
    assert (world.sonar(0) == before).all()
    assert not world.infrared(0).all()


def test_the_walls_belong_to_the_caller() -> None:
    walls = WALLS.copy()
    world = World(walls=walls, poses=[LOOP.start], config=IDEAL)
    before = world.sonar(0)
    walls[:] = 0.0
    world.advance(0.1)
    assert (world.sonar(0) == before).all()


def test_readings_have_their_shapes_and_ranges() -> None:
    world = World(walls=WALLS, poses=[LOOP.start])
    readings, seen = world.sonar(0), world.infrared(0)
    assert readings.shape == seen.shape == (24,)
    assert readings.dtype == np.float64
    assert seen.dtype == np.bool_
    assert (readings >= RING.sonar_min_mm).all()
    assert (readings <= RING.sonar_range_mm).all()
    assert all(type(v) is float for v in (*world.true_pose(0), *world.odometry(0), *world.speed(0)))
    assert all(type(v) is bool for v in world.bumper(0))


def test_a_robot_stands_until_it_is_commanded() -> None:
    world = World(walls=WALLS, poses=[LOOP.start])
    world.advance(1.0)
    assert world.true_pose(0) == pytest.approx(LOOP.start)
    assert world.odometry(0) == world.true_pose(0)
    assert world.distance(0) == 0.0


def test_walls_without_length_and_a_world_without_walls() -> None:
    assert len(World(walls=[(900.0, 0.0, 900.0, 0.0)], poses=[(0.0, 0.0, 0.0)])) == 1
    assert len(World(walls=[], poses=[(0.0, 0.0, 0.0)])) == 1


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: World(walls=[[1.0, 2.0]], poses=[(0, 0, 0)]), "expected \\(n, 4\\)"),
        (lambda: World(walls=[[1.0, 2.0, 3.0, math.nan]], poses=[(0, 0, 0)]), "not finite"),
        (lambda: World(walls=[], poses=[]), "poses"),
        (lambda: World(walls=[], poses=[(0, 0)]), "poses"),
        (lambda: World(walls=[], poses=[(0, 0, math.inf)]), "not finite"),
        (
            lambda: World(walls=[(300, -900, 300, 900)], poses=[(0, 0, 0)]),
            "300 mm from a wall; expected at least 400",
        ),
        (lambda: World(walls=[], poses=[(0, 0, 0), (700, 0, 0)]), "robot 1 .* overlaps robot 0"),
    ],
)
def test_impossible_worlds_are_refused(build: Callable[[], World], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build()


def test_impossible_calls_are_refused() -> None:
    world = World(walls=[], poses=[(0.0, 0.0, 0.0)])
    for speeds in ((math.nan, 0.0), (0.0, math.inf)):
        with pytest.raises(ValueError, match="finite"):
            world.command(0, *speeds)
    for dt in (0.0, -1.0, math.nan, 11.0):
        with pytest.raises(ValueError, match="expected a time"):
            world.advance(dt)
    for robot in (-1, 1):
        with pytest.raises(IndexError, match="expected 0 to 0"):
            world.sonar(robot)
    with pytest.raises(ValueError, match="not finite"):
        world.set_odometry(0, (0.0, 0.0, math.nan))
