"""The local mapper of the thesis in the simulator: RoME with its errors, on the corridors of the loop."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from colony.nav.maps.stickrep.model import Pose
from colony.nav.maps.stickrep.reader import load_map
from colony.nav.maps.walls import walls_of
from colony.runtime.library import data
from colony.sim.world.world import World
from studies.thesis.local_mapper import local_mapper, local_pose
from tests.nav.pose.bench import Bench, drive
from tests.paths import MAPS
from tests.sim.robots import ROME

LOOP = MAPS / "loop.stickrep"
WALLS = walls_of(load_map(LOOP))
SOUTH = 1_270.0
"""The middle of the corridor."""

LIGHTS = (8_000.0, 12_200.0, 16_400.0, 20_600.0, 24_800.0)


def with_lights(turn: float, count: int) -> tuple[Bench, list[float]]:
    """Drive below so many lights with a heading that is off; gives the error of the heading after each."""
    still = replace(ROME, wheel_scale=0.0, wheel_slip_mm=0.0)
    world = World(walls=WALLS.segments, poses=[(6_000.0, SOUTH, 270.0)], config=still)
    robot = Bench(world, local_mapper(), cross_talk=0.005)
    at = world.true_pose(0)
    world.set_odometry(0, (at.x_mm, at.y_mm + 150.0, at.heading_deg + turn))
    robot.ask(data.set_many({"GoalDirection": 270.0, "GoalDistance": float(count)}))
    robot.ask(data.create_semaphore("$StartMap", 1))
    robot.ask(data.create_semaphore("$LightDet", 2))  # two were left over
    errors = []
    for x in LIGHTS[:count]:
        drive(robot, [(x, SOUTH)], speed=300.0)
        robot.ask(data.signal("$LightDet"))
        drive(robot, [(x + 400.0, SOUTH)], speed=300.0)
        errors.append(robot.heading_error_deg)
    return robot, errors


@pytest.mark.parametrize("turn", [6.0, -9.0])
def test_the_thesis_mapper_corrects_the_heading_at_the_third_light(turn: float) -> None:
    robot, errors = with_lights(turn, 4)
    assert errors[:2] == pytest.approx([turn, turn])
    assert abs(errors[2]) < 1.5
    assert errors[3] == pytest.approx(errors[2])
    assert robot.adjusted == 1
    assert (robot.semaphore("$StartMap"), robot.semaphore("$LightDet")) == (0, 0)


def test_the_maps_of_the_thesis_mapper_share_the_light_between_them() -> None:
    robot, errors = with_lights(6.0, 5)
    assert robot.adjusted == 2  # below the third light and the fifth
    assert abs(errors[4]) < 1.5


def test_the_thesis_mapper_leaves_the_position_alone() -> None:
    robot, _ = with_lights(0.0, 3)
    assert robot.adjusted == 1
    assert robot.position_error_mm == pytest.approx((0.0, 150.0), abs=60.0)


def test_the_thesis_mapper_does_nothing_below_two_lights() -> None:
    robot, errors = with_lights(6.0, 2)
    assert errors == pytest.approx([6.0, 6.0])
    assert robot.adjusted == 0


def test_the_local_frame_of_a_pose() -> None:
    west = Pose(1_000.0, 2_000.0, 90.0)
    local = local_pose(west, Pose(700.0, 2_100.0, 80.0))
    assert local == pytest.approx((300.0, -100.0, math.radians(-10.0)))
