"""Robots of several kinds in one world: each is seen and hit by its own hull, and has its own limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from colony.body.devices import LidarSpec as LidarDevice
from colony.body.shipped import shipped_body
from colony.sim.config import config_of
from colony.sim.devices.ranging import Lidar
from colony.sim.hazards.scenery import CorridorTrack, Person, bare_scenery
from colony.sim.world.world import World
from tests.sim.robots import IDEAL, pass_time, with_ring

SMALL = replace(IDEAL, acceleration_mm_s2=1e9, turn_acceleration_deg_s2=1e9)
LARGE = replace(SMALL, radius_mm=700.0, wheel_base_mm=900.0, max_velocity_mm_s=250.0, ring=None)
SLOW = replace(SMALL, command_delay_ns=100_000_000)
GAP_MM = 3000.0


def pair(first: object, second: object, **options: object) -> World:
    """Two robots that face each other, 3 m from center to center."""
    poses = [(0.0, 0.0, 0.0), (0.0, GAP_MM, 180.0)]
    return World(walls=(), poses=poses, config=[first, second], **options)  # type: ignore[list-item, arg-type]


def test_a_sonar_hears_another_robot_at_its_own_hull() -> None:
    world = pair(SMALL, LARGE)
    ring = SMALL.ring
    assert world.sonar(0)[ring.ahead] == pytest.approx(GAP_MM - LARGE.radius_mm - ring.ring_mm)
    assert pair(SMALL, SMALL).sonar(0)[ring.ahead] == pytest.approx(GAP_MM - SMALL.radius_mm - ring.ring_mm)


def test_a_robot_without_a_ring_has_no_sonar_beside_one_that_has() -> None:
    world = pair(LARGE, SMALL)
    with pytest.raises(ValueError, match="robot 0 has no ring"):
        world.sonar(0)
    assert len(world.sonar(1)) == SMALL.channels


def test_rings_of_several_kinds_read_as_each_does_alone() -> None:
    walls = [(-2_000.0, -1_500.0, -2_000.0, 5_000.0), (2_500.0, 5_000.0, 2_500.0, -1_500.0)]
    other = with_ring(SMALL, channels=8, ahead=0, infrared_wired=(0, 3))
    poses = [(0.0, 0.0, 20.0), (100.0, GAP_MM, 200.0), (900.0, 1_000.0, 0.0)]
    mixed = World(walls=walls, poses=poses, config=[SMALL, other, SMALL])
    for robot, kind in enumerate((SMALL, other, SMALL)):
        alike = World(walls=walls, poses=poses, config=kind)
        assert np.array_equal(mixed.sonar(robot), alike.sonar(robot))
        assert np.array_equal(mixed.infrared(robot), alike.infrared(robot))


def test_a_scanner_sees_another_robot_at_its_own_hull() -> None:
    device = shipped_body("amr").servers["Lidar"].simulated
    assert isinstance(device, LidarDevice)
    exact = replace(device, noise_mm=0.0, dropouts=0.0)
    world = pair(LARGE, SMALL)
    ahead = device.count // 2
    for robot, hull in ((0, SMALL), (1, LARGE)):
        ranges = Lidar(exact, world, robot, blocked=(), seed=1).measure(exact.field)
        assert ranges[ahead] == pytest.approx(GAP_MM - hull.radius_mm)


def test_hulls_touch_at_the_sum_of_their_radii() -> None:
    for first, second in ((SMALL, LARGE), (LARGE, SMALL), (SMALL, SMALL)):
        world = pair(first, second)
        world.command(0, 250.0, 0.0)
        pass_time(world, 20.0)
        pose = world.true_pose(0)
        assert GAP_MM - pose.y_mm == pytest.approx(first.radius_mm + second.radius_mm, abs=1.0)
        assert world.bumper(0).front
        assert world.bumper(1).front
        assert (world.bumps(0), world.bumps(1)) == (1, 1)


def test_each_robot_has_its_own_limits_and_delay() -> None:
    poses = [(0.0, 0.0, 0.0), (3_000.0, 0.0, 0.0), (6_000.0, 0.0, 0.0)]
    world = World(walls=(), poses=poses, config=[SMALL, LARGE, SLOW])
    for robot in range(3):
        world.command(robot, 1_000.0, 0.0)
    world.advance(0.3)
    driven = [world.true_pose(robot).y_mm for robot in range(3)]
    assert driven[0] == pytest.approx(0.3 * SMALL.max_velocity_mm_s)
    assert driven[1] == pytest.approx(0.3 * LARGE.max_velocity_mm_s)
    assert driven[2] == pytest.approx(0.2 * SMALL.max_velocity_mm_s)


def test_commands_take_effect_in_the_order_of_their_delays() -> None:
    slower = replace(SMALL, command_delay_ns=200_000_000)
    world = pair(slower, SLOW)
    order: list[int] = []
    world.carry_out(0, lambda: order.append(0))
    world.carry_out(1, lambda: order.append(1))
    world.carry_out(1, lambda: order.append(2))
    world.advance(0.5)
    assert order == [1, 2, 0]


def test_robots_do_not_start_inside_each_other() -> None:
    with pytest.raises(ValueError, match="overlaps robot 0"):
        World(walls=(), poses=[(0.0, 0.0, 0.0), (0.0, 1_100.0, 0.0)], config=[LARGE, LARGE])
    World(walls=(), poses=[(0.0, 0.0, 0.0), (0.0, 1_100.0, 0.0)], config=[LARGE, SMALL])
    with pytest.raises(ValueError, match="expected one for each robot, 2"):
        World(walls=(), poses=[(0.0, 0.0, 0.0), (0.0, 2_000.0, 0.0)], config=[LARGE])


def test_people_keep_clear_of_each_hull() -> None:
    track = CorridorTrack(x_mm=0.0, y_mm=0.0, heading_deg=0.0, length_mm=9_000.0, half_width_mm=1_000.0)
    person = Person(track=track, along_mm=8_000.0, offset_mm=0.0, forward=False, speed_mm_s=1_200.0)
    scenery = replace(bare_scenery(np.empty((0, 4))), people=(person,))
    for radius in (300.0, 700.0):
        config = replace(LARGE, radius_mm=radius)
        world = World(walls=scenery, poses=[(0.0, 2_000.0, 0.0), (9_000.0, 0.0, 0.0)], config=[config, SMALL])
        nearest = 1e9
        for _ in range(1_200):
            world.advance(0.05)
            nearest = min(nearest, float(np.hypot(*(world.people[0] - (0.0, 2_000.0)))))
        assert nearest >= radius + world.person_radius_mm
        assert world.bumps(0) == 0


def test_kinds_of_shipped_robots_share_a_world() -> None:
    configs = [config_of(shipped_body(name)) for name in ("amr", "rome")]
    world = World(walls=(), poses=[(0.0, 0.0, 0.0), (5_000.0, 0.0, 0.0)], config=configs, seed=3)
    again = World(walls=(), poses=[(0.0, 0.0, 0.0), (5_000.0, 0.0, 0.0)], config=configs, seed=3)
    for each in (world, again):
        each.command(0, 500.0, 10.0)
        each.command(1, 400.0, -10.0)
        for _ in range(50):
            each.advance(0.1)
    assert np.array_equal(world.true_poses, again.true_poses)
    assert np.array_equal(world.sonar(1), again.sonar(1))
    assert world.situation().radii.tolist() == [each.radius_mm for each in configs]


def test_each_robot_reports_the_wheels_that_it_has() -> None:
    amr, omni = config_of(shipped_body("amr")), config_of(shipped_body("omni"))
    world = pair(amr, omni)
    world.advance(0.1)
    assert [len(world.travel(robot)) for robot in (0, 1)] == [2, 4]
