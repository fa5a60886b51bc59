"""Motion, collisions and odometry of a base that drives sideways, against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colony.body.devices import MountPose
from colony.body.model import Omnidirectional
from colony.sim.config import RobotConfig
from colony.sim.world.world import STILL, Speed, World
from tests.sim.robots import IDEAL, ROME, SIDEWAYS, pass_time

MECANUM = replace(IDEAL, **SIDEWAYS)
FAST = replace(MECANUM, acceleration_mm_s2=1e9, turn_acceleration_deg_s2=1e9, sideways_acceleration_mm_s2=1e9)
RADIUS = MECANUM.radius_mm
KIWI = tuple(
    MountPose(
        150.0 * math.cos(math.radians(bearing)), 150.0 * math.sin(math.radians(bearing)), bearing + 90.0
    )
    for bearing in (60.0, 180.0, -60.0)
)
"""Three omni wheels at 120 degrees, 150 mm from the center."""
UNEVEN = (*KIWI[:2], MountPose(-40.0, -170.0, 10.0), MountPose(200.0, 30.0, 45.0))


def on_wheels(wheels: tuple[MountPose, ...], config: RobotConfig = FAST) -> RobotConfig:
    return replace(config, omni_wheels=Omnidirectional(wheels=wheels).rolling)


def driven(
    velocity: float,
    turn: float,
    sideways: float,
    seconds: float,
    heading: float = 0.0,
    walls: object = (),
    config: object = FAST,
    seed: int = 0,
) -> World:
    world = World(walls=walls, poses=[(0.0, 0.0, heading)], config=config, seed=seed)  # type: ignore[arg-type]
    world.command(0, velocity, turn, sideways)
    pass_time(world, seconds)
    return world


@pytest.mark.parametrize(
    ("heading", "x", "y"),
    [(0, -900, 0), (90, 0, -900), (180, 900, 0), (270, 0, 900), (45, -636.396, -636.396)],
)
def test_sideways_is_to_the_left(heading: float, x: float, y: float) -> None:
    world = driven(0.0, 0.0, 300.0, 3.0, heading)
    assert world.true_pose(0) == pytest.approx((x, y, heading), abs=1e-3)
    assert world.distance(0) == pytest.approx(900.0)
    assert world.speed(0) == Speed(0.0, 0.0, 300.0)


def test_sideways_and_ahead_make_a_diagonal() -> None:
    world = driven(300.0, 0.0, -400.0, 2.0)
    assert world.true_pose(0) == pytest.approx((800.0, 600.0, 0.0), abs=1e-6)
    assert world.distance(0) == pytest.approx(1000.0)
    assert world.speed(0).ground_mm_s == 500.0


def test_a_turn_bends_the_way_sideways_to_a_circle() -> None:
    world = driven(0.0, 30.0, 200.0, 3.0)  # a quarter turn, and the way to the left turns along
    radius = 200.0 / math.radians(30.0)
    assert world.true_pose(0) == pytest.approx((-radius, -radius, 90.0), abs=1e-6)
    full = driven(100.0, 30.0, 200.0, 12.0)
    assert full.true_pose(0)[:2] == pytest.approx((0.0, 0.0), abs=1e-6)
    assert full.distance(0) == pytest.approx(math.hypot(100.0, 200.0) * 12.0)


def test_the_sideways_speed_rises_within_its_acceleration_up_to_its_limit() -> None:
    world = driven(0.0, 0.0, 9000.0, 0.5, config=MECANUM)
    assert world.speed(0).sideways_mm_s == pytest.approx(200.0)
    world.advance(1.0)
    assert world.speed(0) == Speed(0.0, 0.0, 500.0)
    world.command(0, 0.0, 0.0)
    world.advance(2.0)
    assert world.speed(0) == STILL


def test_a_base_with_two_wheels_does_not_drive_sideways() -> None:
    world = driven(0.0, 0.0, 300.0, 1.0, config=IDEAL)
    assert world.speed(0) == STILL
    assert world.true_pose(0) == (0.0, 0.0, 0.0)


def test_a_wall_beside_the_base_stops_it() -> None:
    wall = [(-1000.0, -5000.0, -1000.0, 5000.0)]
    world = driven(100.0, 10.0, 300.0, 4.0, walls=wall)
    assert world.true_pose(0).x_mm == pytest.approx(-1000.0 + RADIUS, abs=1e-3)
    assert world.bumps(0) == 1
    assert world.contact_speed(0) == pytest.approx(math.hypot(100.0, 300.0))
    assert world.true_pose(0).heading_deg == pytest.approx(40.0)
    assert world.odometry(0) == pytest.approx(world.true_pose(0), abs=1e-6)
    world.command(0, 0.0, 0.0, -300.0)
    world.advance(1.0)
    assert world.true_pose(0).x_mm > -1000.0 + RADIUS + 100.0


@settings(max_examples=30, deadline=None)
@given(
    velocity=st.floats(-600.0, 600.0),
    turn=st.floats(-90.0, 90.0),
    sideways=st.floats(-500.0, 500.0),
    heading=st.floats(0.0, 359.0),
    config=st.sampled_from([MECANUM, on_wheels(KIWI, MECANUM), on_wheels(UNEVEN, MECANUM)]),
)
def test_without_errors_odometry_is_the_true_pose(
    velocity: float, turn: float, sideways: float, heading: float, config: RobotConfig
) -> None:
    world = driven(velocity, turn, sideways, 1.0, heading, config=config)
    pose, odometry = world.true_pose(0), world.odometry(0)
    assert odometry[:2] == pytest.approx(pose[:2], abs=1e-6)
    assert math.remainder(odometry.heading_deg - pose.heading_deg, 360.0) == pytest.approx(0.0, abs=1e-9)


def test_the_scale_of_a_wheel_bends_what_odometry_takes_for_the_way() -> None:
    world = World(walls=(), poses=[(0.0, 0.0, 0.0)], config=FAST)
    world._bases.scales[0] = (1.0, 1.0, 1.0, 1.04)  # the rear right wheel counts too much
    world.command(0, 0.0, 0.0, 250.0)
    world.advance(0.02)  # one slice: 5 mm to the left, for which this wheel rolls 5 mm backward
    odometry, reach = world.odometry(0), 320.0
    assert odometry.x_mm == pytest.approx(-5.05, abs=1e-3)
    assert odometry.y_mm == pytest.approx(-0.05, abs=1e-3)
    assert odometry.heading_deg - 360.0 == pytest.approx(-math.degrees(0.2 / (4.0 * reach)))


def test_three_omni_wheels_roll_as_their_directions_say() -> None:
    ahead = driven(300.0, 0.0, 0.0, 1.0, config=on_wheels(KIWI)).travel(0)
    assert ahead == pytest.approx((-300.0 * math.sqrt(0.75), 0.0, 300.0 * math.sqrt(0.75)))
    left = driven(0.0, 0.0, 300.0, 1.0, config=on_wheels(KIWI)).travel(0)
    assert left == pytest.approx((150.0, -300.0, 150.0))
    turned = driven(0.0, 60.0, 0.0, 1.0, config=on_wheels(KIWI)).travel(0)
    assert turned == pytest.approx([math.radians(60.0) * 150.0] * 3)


def test_wheels_of_both_kinds_drive_in_one_world() -> None:
    world = World(
        walls=(), poses=[(0.0, 0.0, 0.0), (5_000.0, 0.0, 0.0)], config=[on_wheels(UNEVEN), IDEAL], seed=1
    )
    for robot in (0, 1):
        world.command(robot, 200.0, 20.0)
    pass_time(world, 2.0)
    for robot in (0, 1):
        assert world.odometry(robot) == pytest.approx(world.true_pose(robot), abs=1e-6)
    assert [len(world.travel(robot)) for robot in (0, 1)] == [4, 2]


def test_the_error_of_the_way_sideways_is_that_of_four_wheels() -> None:
    config = replace(FAST, wheel_slip_mm=ROME.wheel_slip_mm)
    worlds = [driven(0.0, 0.0, 500.0, 2.0, config=config, seed=seed) for seed in range(300)]
    errors = np.array([world.odometry(0)[:2] for world in worlds]) - (-1000.0, 0.0)
    spread = ROME.wheel_slip_mm / 2.0  # the mean of four wheels, each over a meter
    assert np.std(errors[:, 0]) == pytest.approx(spread, rel=0.15)
    assert np.abs(np.mean(errors[:, 0])) < 0.2 * spread


def test_wheels_roll_as_fast_as_the_way_takes() -> None:
    assert driven(0.0, 0.0, 300.0, 1.0).wheel_speed(0) == pytest.approx(300.0)
    reach = 320.0
    assert driven(0.0, 60.0, 0.0, 1.0).wheel_speed(0) == pytest.approx(math.radians(60.0) * reach)
    assert driven(300.0, 0.0, 300.0, 1.0).wheel_speed(0) == pytest.approx(300.0)  # two of them stand


@pytest.mark.parametrize(
    "changes", [{"max_sideways_mm_s": 0.0}, {"sideways_acceleration_mm_s2": 0.0}, {"omni_wheels": ()}]
)
def test_a_robot_has_all_that_it_takes_to_drive_sideways_or_nothing(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"above 0|to be 0"):
        replace(MECANUM, **changes)
