"""Motion, collisions, bumpers and odometry against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colony.sim.config import RobotConfig
from colony.sim.world.base import SLICE_S
from colony.sim.world.world import Speed, World
from tests.sim.robots import IDEAL, pass_time

RADIUS = IDEAL.radius_mm
AGILE = replace(IDEAL, acceleration_mm_s2=1e9, turn_acceleration_deg_s2=1e9)
NORTH_WALL = (-50_000.0, 5_000.0, 50_000.0, 5_000.0)
ROOM = [(0, 0, 0, 8_000), (0, 8_000, 8_000, 8_000), (8_000, 8_000, 8_000, 0), (8_000, 0, 0, 0)]


def driven(
    velocity: float,
    turn: float,
    seconds: float,
    heading: float = 0.0,
    walls: object = (),
    config: RobotConfig = AGILE,
) -> World:
    world = World(walls=walls, poses=[(0.0, 0.0, heading)], config=config)
    world.command(0, velocity, turn)
    pass_time(world, seconds)
    return world


@pytest.mark.parametrize(
    ("drive", "heading", "pose"),
    [
        *(
            ((300.0, 0.0), h, (x, y, h))
            for h, x, y in ((0, 0, 900), (90, -900, 0), (180, 0, -900), (270, 900, 0))
        ),
        ((300.0, 0.0), 45, (-636.396, 636.396, 45)),
        ((-300.0, 0.0), 0, (0, -900, 0)),
        ((0.0, 30.0), 0, (0, 0, 90)),  # counterclockwise
        ((0.0, -30.0), 0, (0, 0, 270)),
    ],
)
def test_a_base_drives_ahead_and_back_and_turns(
    drive: tuple[float, float], heading: float, pose: tuple[float, float, float]
) -> None:
    world = driven(*drive, 3.0, heading)
    assert world.true_pose(0) == pytest.approx(pose, abs=1e-3)
    assert world.distance(0) == pytest.approx(900.0 if drive[0] else 0.0)


def test_an_arc_is_part_of_a_circle() -> None:
    world = driven(200.0, 30.0, 3.0)  # a quarter turn to the left
    radius = 200.0 / math.radians(30.0)
    assert world.true_pose(0) == pytest.approx((-radius, radius, 90.0), abs=1e-6)
    full = driven(200.0, 30.0, 12.0)
    assert full.true_pose(0)[:2] == pytest.approx((0.0, 0.0), abs=1e-6)
    assert full.distance(0) == pytest.approx(2.0 * math.pi * radius)


def test_speeds_rise_as_fast_as_the_base_can() -> None:
    world = driven(600.0, 0.0, 0.5, config=IDEAL)
    assert world.speed(0).velocity_mm_s == pytest.approx(0.5 * IDEAL.acceleration_mm_s2)
    # A staircase of slices, slightly ahead of the parabola.
    exact = 0.5 * IDEAL.acceleration_mm_s2 * 0.5**2
    assert exact <= world.distance(0) <= exact + 0.5 * IDEAL.acceleration_mm_s2 * 0.5 * SLICE_S + 1e-6
    world.advance(1.0)
    assert world.speed(0) == Speed(600.0, 0.0)


def test_commands_are_clamped() -> None:
    world = driven(1e9, -1e9, 1.0)
    assert world.speed(0) == Speed(IDEAL.max_velocity_mm_s, -IDEAL.max_turn_deg_s)


def test_a_wall_stops_the_robot_at_its_hull() -> None:
    world = driven(600.0, 0.0, 12.0, walls=[NORTH_WALL])
    assert world.true_pose(0) == pytest.approx((0.0, 5_000.0 - RADIUS, 0.0), abs=1e-6)
    assert world.speed(0).velocity_mm_s == 0.0
    assert world.distance(0) == pytest.approx(5_000.0 - RADIUS)
    assert world.bumper(0) == (True, False)
    assert world.bumps(0) == 1


def test_backing_into_a_wall_presses_the_rear_bumper() -> None:
    world = driven(-600.0, 0.0, 12.0, heading=180.0, walls=[NORTH_WALL])
    assert world.true_pose(0).y_mm == pytest.approx(5_000.0 - RADIUS)
    assert world.bumper(0) == (False, True)


def test_the_robot_can_turn_at_a_wall_and_leave_it() -> None:
    world = driven(600.0, 0.0, 12.0, walls=[NORTH_WALL])
    world.command(0, 0.0, 90.0)
    pass_time(world, 2.0)
    assert world.true_pose(0).heading_deg == pytest.approx(180.0)
    assert world.bumper(0) == (False, True)
    assert world.bumps(0) == 1
    world.command(0, 300.0, 0.0)
    world.advance(1.0)
    assert world.true_pose(0).y_mm == pytest.approx(5_000.0 - RADIUS - 300.0)
    assert world.bumper(0) == (False, False)
    world.command(0, -300.0, 0.0)
    world.advance(2.0)
    assert world.bumps(0) == 2


def test_a_bump_within_a_long_step_counts() -> None:
    # The robot runs into the wall, turns away from it by itself, and is far from it when the step is over.
    world = World(walls=[NORTH_WALL], poses=[(0.0, 4_500.0, 0.0)], config=AGILE)
    world.command(0, 200.0, 20.0)
    world.advance(9.0)
    assert world.bumper(0) == (False, False)
    assert world.bumps(0) == 1


def test_the_end_of_a_wall_is_an_obstacle_too() -> None:
    world = driven(600.0, 0.0, 12.0, walls=[(0.0, 3_000.0, 0.0, 5_000.0)])
    assert world.true_pose(0).y_mm == pytest.approx(3_000.0 - RADIUS)


def test_a_robot_may_pass_along_a_wall() -> None:
    beside = (RADIUS + 5.0, -10_000.0, RADIUS + 5.0, 10_000.0)
    world = driven(600.0, 0.0, 5.0, walls=[beside])
    assert world.distance(0) == pytest.approx(3_000.0)
    assert world.bumps(0) == 0


@settings(deadline=None)
@given(
    commands=st.lists(
        st.tuples(st.floats(-600.0, 600.0), st.floats(-90.0, 90.0), st.floats(0.01, 3.0)),
        min_size=1,
        max_size=12,
    ),
    heading=st.floats(0.0, 360.0),
)
def test_no_robot_gets_through_a_wall_or_another_robot(
    commands: list[tuple[float, float, float]], heading: float
) -> None:
    poses = [(4_000.0, 4_000.0, heading), (4_900.0, 4_000.0, -heading), (4_000.0, 4_900.0, 0.0)]
    world = World(walls=ROOM, poses=poses, config=AGILE)
    for velocity, turn, seconds in commands:
        for robot in range(3):
            world.command(robot, velocity, turn if robot else -turn)
        world.advance(seconds)
        places = np.array([world.true_pose(robot)[:2] for robot in range(3)])
        assert (places >= RADIUS - 1e-6).all()
        assert (places <= 8_000.0 - RADIUS + 1e-6).all()
        for i in range(3):
            for j in range(i):
                assert np.hypot(*(places[i] - places[j])) >= 2 * RADIUS - 1e-6


@pytest.mark.parametrize("radius", [15.0, 125.0])
@pytest.mark.parametrize("obstacle", ["wall", "tip of a wall", "robot"])
def test_a_base_that_moves_farther_than_its_hull_in_a_slice_jumps_over_nothing(
    obstacle: str, radius: float
) -> None:
    fast = replace(AGILE, ring=None, radius_mm=radius, max_velocity_mm_s=30_000.0)
    tip = (0.6 * radius, 5_000.0, 50_000.0, 5_000.0)
    walls = {"wall": [NORTH_WALL], "tip of a wall": [tip], "robot": []}[obstacle]
    poses = [(0.0, 0.0, 0.0), (0.0, 5_000.0, 0.0)][: 2 if obstacle == "robot" else 1]
    reach = {"wall": radius, "tip of a wall": 0.8 * radius, "robot": 2.0 * radius}[obstacle]
    world = World(walls=walls, poses=poses, config=fast)
    world.command(0, 30_000.0, 0.0)
    pass_time(world, 0.5)
    assert world.true_pose(0).y_mm == pytest.approx(5_000.0 - reach, abs=1e-3)
    assert world.bumps(0) == 1


def test_parameters_may_be_whole_numbers() -> None:
    whole = replace(AGILE, ring=None, radius_mm=300)
    assert driven(100.0, 0.0, 1.0, walls=[NORTH_WALL], config=whole).true_pose(0) == (0.0, 100.0, 0.0)


def test_robots_stop_each_other_and_both_feel_it() -> None:
    world = World(walls=[], poses=[(0.0, 0.0, 0.0), (0.0, 2_000.0, 90.0)], config=AGILE)
    world.command(0, 600.0, 0.0)
    world.advance(5.0)
    assert world.true_pose(0).y_mm == pytest.approx(2_000.0 - 2 * RADIUS)
    assert world.bumper(0) == (True, False)
    # The other one looks west: what pushes it from the south is exactly at its side, where the halves meet.
    assert any(world.bumper(1))
    assert world.true_pose(1) == (0.0, 2_000.0, 90.0)


def test_a_step_may_be_cut_into_smaller_ones() -> None:
    whole, parts = driven(0.0, 0.0, 0.0), driven(0.0, 0.0, 0.0)
    for world in (whole, parts):
        world.command(0, 400.0, 25.0)
    whole.advance(1.0)
    for _ in range(10):
        parts.advance(0.1)
    assert whole.true_pose(0) == pytest.approx(parts.true_pose(0))


def test_odometry_can_be_set_and_counts_on_from_there() -> None:
    world = driven(0.0, 0.0, 0.0)
    world.set_odometry(0, (1_000.0, 2_000.0, 450.0))
    assert world.odometry(0) == (1_000.0, 2_000.0, 90.0)
    world.command(0, 300.0, 0.0)
    world.advance(1.0)
    assert world.odometry(0) == pytest.approx((700.0, 2_000.0, 90.0))
    assert world.true_pose(0) == pytest.approx((0.0, 300.0, 0.0))


def straight_runs(config: RobotConfig, seconds: float, robots: int = 400) -> np.ndarray:
    """Where robots that drive straight north believe they are: (robots, 3), headings from -180 to 180."""
    poses = [(2_000.0 * i, 0.0, 0.0) for i in range(robots)]
    world = World(walls=[], poses=poses, config=config, seed=11)
    for robot in range(robots):
        world.command(robot, 500.0, 0.0)
    pass_time(world, seconds, 0.5)
    found = np.array([world.odometry(robot) for robot in range(robots)])
    found[:, 0] -= 2_000.0 * np.arange(robots)
    found[:, 2] = (found[:, 2] + 180.0) % 360.0 - 180.0
    return found


def test_slip_grows_with_the_square_root_of_the_way() -> None:
    config = replace(AGILE, wheel_slip_mm=4.0)
    for meters in (1.0, 9.0):
        found = straight_runs(config, meters / 0.5)
        wheel = 4.0 * math.sqrt(meters)
        heading = math.degrees(math.sqrt(2.0) * wheel / config.wheel_base_mm)
        assert np.std(found[:, 2]) == pytest.approx(heading, rel=0.12)
        assert np.mean(found[:, 2]) == pytest.approx(0.0, abs=4 * heading / 20.0)
        assert np.mean(found[:, 1]) == pytest.approx(1_000.0 * meters, rel=0.01)
    short = straight_runs(config, 2.0)
    assert np.std(short[:, 1]) == pytest.approx(4.0 / math.sqrt(2.0), rel=0.12)


def test_scale_errors_grow_with_the_way_and_stay_with_the_robot() -> None:
    config = replace(AGILE, wheel_scale=0.01)
    near, far = straight_runs(config, 2.0), straight_runs(config, 4.0)
    drift = math.degrees(1_000.0 * 0.01 * math.sqrt(2.0) / config.wheel_base_mm)
    assert np.std(near[:, 2]) == pytest.approx(drift, rel=0.12)
    assert far[:, 2] == pytest.approx(2.0 * near[:, 2])
