"""Encoders of wheels."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from colony.sim.hazards.scenery import ExpansionJoint, WheelSlip, bare_scenery
from tests.sim.devices.stage import CHASSIS, MECANUM, Stage

EXACT = """
[server.Wheels.simulated]
device = "encoders"
"""
TICKS = EXACT + 'resolution = "2.5 mm"\n'


def travel(stage: Stage) -> tuple[float, ...]:
    found = stage.read("Wheels", "travel")
    assert isinstance(found, tuple)
    return found


ERRORS = 'wheel_base = "400 mm"\nscale_error = "2 percent"\nslip = "5 mm"'
SKEWED = CHASSIS.replace('wheel_base = "400 mm"', ERRORS)
"""Wheels with errors of scale, and with slip."""


def test_wheels_roll_as_far_as_the_robot_drives_and_turns() -> None:
    stage = Stage(EXACT)
    assert travel(stage) == (0.0, 0.0)
    stage.drive(2.0, 500.0)
    driven = stage.world.distance(0)
    assert travel(stage) == pytest.approx((driven, driven))
    heading = stage.world.true_pose(0).heading_deg
    stage.drive(1.0, 0.0, 45.0)
    half = math.radians(stage.world.true_pose(0).heading_deg - heading) * 200.0
    assert travel(stage) == pytest.approx((driven - half, driven + half))
    stage.drive(3.0, -500.0)
    left, right = travel(stage)
    back = driven - (stage.world.distance(0) - driven)
    assert (left + right) / 2.0 == pytest.approx(back)


def test_wheels_that_stall_roll_nothing() -> None:
    stage = Stage(EXACT, walls=[[-1000.0, 500.0, 1000.0, 500.0]])
    stage.drive(3.0, 500.0)
    assert travel(stage) == pytest.approx((200.0, 200.0), abs=1.0)
    assert travel(stage)[0] == pytest.approx(stage.world.distance(0))


def test_dead_reckoning_is_made_of_what_encoders_read() -> None:
    stage = Stage(EXACT, chassis=SKEWED)
    x = y = heading = 0.0
    before = travel(stage)
    for step in range(400):
        stage.world.command(0, 400.0, 60.0 * math.sin(step / 40.0))
        stage.world.advance(0.02)  # one slice: an exact arc
        now = travel(stage)
        left, right = now[0] - before[0], now[1] - before[1]
        before, turn = now, (right - left) / 400.0
        chord = (left + right) / 2.0 * (math.sin(turn / 2.0) / (turn / 2.0) if turn else 1.0)
        x -= chord * math.sin(heading + turn / 2.0)
        y += chord * math.cos(heading + turn / 2.0)
        heading += turn
    odometry, true = stage.world.odometry(0), stage.world.true_pose(0)
    assert (x, y) == pytest.approx(odometry[:2], abs=1e-3)
    assert math.degrees(heading) % 360.0 == pytest.approx(odometry.heading_deg, abs=1e-4)
    assert math.hypot(x - true.x_mm, y - true.y_mm) > 1.0  # the errors are those of the wheels


def test_readings_are_whole_ticks() -> None:
    stage, exact = Stage(TICKS), Stage(EXACT)
    for pair in (stage, exact):
        pair.drive(0.7, -123.0, 20.0)
    for ticks, rolled in zip(travel(stage), travel(exact), strict=True):
        assert ticks % 2.5 == 0.0
        assert ticks <= rolled < ticks + 2.5


def test_a_robot_that_is_carried_rolls_nothing() -> None:
    stage = Stage(EXACT)
    stage.world.place(0, (5000.0, 0.0, 90.0))
    stage.world.set_odometry(0, (1.0, 2.0, 3.0))
    stage.advance(1.0)
    assert travel(stage) == (0.0, 0.0)


def test_wheels_that_spin_on_a_joint_roll_on() -> None:
    joint = ExpansionJoint(x0_mm=-2000.0, y0_mm=500.0, x1_mm=2000.0, y1_mm=500.0)
    slip = WheelSlip(probability=1.0, turn_deg=0.0, min_mm=60.0, max_mm=60.0)
    scenery = replace(bare_scenery(np.empty((0, 4))), joints=(joint,), slip=slip)
    stage = Stage(EXACT, walls=scenery)
    stage.drive(2.0, 500.0)
    driven = stage.world.distance(0)
    assert travel(stage) == pytest.approx((driven + 60.0, driven + 60.0))
    assert stage.world.odometry(0).y_mm == pytest.approx(driven + 60.0)


def test_four_wheels_roll_as_the_base_turns() -> None:
    stage = Stage(EXACT + "wheels = 4\n", chassis=MECANUM)
    stage.drive(1.0, 0.0, 30.0)
    turn = math.radians(stage.world.true_pose(0).heading_deg) * 350.0
    assert travel(stage) == pytest.approx((-turn, turn, -turn, turn))
