"""Inertial units: exact without errors, with the errors that their bodies say, and whenever they are read."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.sim.devices.stage import MECANUM, Stage

IMU = '[server.Imu.simulated]\ndevice = "imu"\n'
FIELDS = ("turn_rate", "acceleration", "sideways_acceleration", "heading")


def readings(stage: Stage, robot: int = 0) -> tuple[float, ...]:
    found = [stage.read("Imu", field, robot) for field in FIELDS]
    assert all(isinstance(value, float) for value in found)
    return tuple(float(value) for value in found if isinstance(value, float))


def test_a_robot_that_stands_reads_its_heading_alone() -> None:
    stage = Stage(IMU, poses=[(0.0, 0.0, 123.0)])
    assert readings(stage) == (0.0, 0.0, 0.0, 123.0)
    stage.advance(1.0)
    assert readings(stage) == pytest.approx((0.0, 0.0, 0.0, 123.0))


def test_a_robot_that_speeds_up_and_brakes_reads_its_acceleration() -> None:
    """The base accelerates by 10 m/s^2, in steps of 50 ms: to 500 mm/s in one step."""
    stage = Stage(IMU)
    stage.world.command(0, 750.0, 0.0)
    stage.world.advance(0.05)
    assert readings(stage) == pytest.approx((0.0, 10_000.0, 0.0, 0.0))
    stage.world.advance(0.05)
    assert readings(stage) == pytest.approx((0.0, 5000.0, 0.0, 0.0))
    stage.world.advance(0.05)
    assert readings(stage) == pytest.approx((0.0, 0.0, 0.0, 0.0))
    stage.world.command(0, 600.0, 0.0)
    stage.world.advance(0.05)
    assert readings(stage) == pytest.approx((0.0, -3000.0, 0.0, 0.0))


@pytest.mark.parametrize("turn", [40.0, -40.0])
def test_a_curve_has_an_acceleration_toward_its_center(turn: float) -> None:
    stage = Stage(IMU)
    stage.world.command(0, 600.0, turn)
    stage.advance(2.0)
    rate, ahead, left, heading = readings(stage)
    radius = 600.0 / math.radians(abs(turn))
    assert (rate, ahead) == pytest.approx((turn, 0.0))
    assert left == pytest.approx(math.copysign(600.0**2 / radius, turn))
    assert heading == pytest.approx(stage.world.true_pose(0).heading_deg)


def test_a_robot_that_speeds_up_sideways_and_turns_reads_its_acceleration() -> None:
    """The base accelerates by 10 m/s^2, in steps of 50 ms."""
    stage = Stage(IMU, chassis=MECANUM)
    stage.world.command(0, 0.0, 0.0, -500.0)
    stage.world.advance(0.05)
    assert readings(stage) == pytest.approx((0.0, 0.0, -10_000.0, 0.0))
    stage.world.command(0, 300.0, 40.0, -500.0)
    stage.advance(2.0)
    turn = math.radians(40.0)
    assert readings(stage)[:3] == pytest.approx((40.0, 500.0 * turn, 300.0 * turn))


@pytest.mark.parametrize("step_s", [0.01, 0.05, 3.0])
def test_the_heading_is_exact_without_errors(step_s: float) -> None:
    stage = Stage(IMU, poses=[(0.0, 0.0, 350.0)])
    for turn in (90.0, -33.0, 0.0, 71.0):
        stage.world.command(0, 100.0, turn)
        stage.advance(6.0, step_s)
        assert stage.read("Imu", "heading") == pytest.approx(stage.world.true_pose(0).heading_deg)


def test_a_collision_is_a_braking() -> None:
    stage = Stage(IMU, walls=[(-5000.0, 800.0, 5000.0, 800.0)])
    stage.world.command(0, 1000.0, 0.0)
    hardest = 0.0
    for _ in range(20):
        stage.world.advance(0.05)
        hardest = min(hardest, readings(stage)[1])
    assert hardest < -10_000.0


def test_it_does_not_notice_that_it_is_placed_elsewhere() -> None:
    stage = Stage(IMU, poses=[(0.0, 0.0, 10.0)])
    stage.drive(1.0, 0.0, 30.0)
    before = stage.read("Imu", "heading")
    stage.world.place(0, (5000.0, 0.0, 200.0))
    stage.advance(1.0)
    assert stage.read("Imu", "heading") == pytest.approx(before)
    stage.drive(1.0, 0.0, 30.0)
    turned = stage.world.true_pose(0).heading_deg - 200.0
    assert stage.read("Imu", "heading") == pytest.approx(float(str(before)) + turned)


NOISE = IMU + 'turn = { noise = "0.5 deg/s" }\nacceleration = { noise = "20 mm/s^2" }\n'


def test_noise_is_normal_and_the_heading_adds_it_up() -> None:
    stage = Stage(NOISE)
    found = []
    for _ in range(5000):
        stage.world.advance(0.05)
        found.append(readings(stage))
    rates, ahead, left, headings = np.array(found).T
    for values, spread in ((rates, 0.5), (ahead, 20.0), (left, 20.0)):
        assert values.mean() == pytest.approx(0.0, abs=4.0 * spread / math.sqrt(len(values)))
        assert values.std() == pytest.approx(spread, rel=4.0 / math.sqrt(2 * len(values)))
        assert (values[1:] * values[:-1]).mean() == pytest.approx(0.0, abs=4.0 * spread**2 / 70.0)
    assert (ahead * left).mean() == pytest.approx(0.0, abs=4.0 * 400.0 / math.sqrt(len(ahead)))
    assert (headings + 180.0) % 360.0 - 180.0 == pytest.approx(np.cumsum(rates) * 0.05, abs=1e-6)


def fleet(errors: str, robots: int = 400) -> Stage:
    return Stage(IMU + errors, poses=[(1000.0 * i, 0.0, 0.0) for i in range(robots)])


def test_each_robot_has_a_bias_that_lasts() -> None:
    stage = fleet('turn = { bias = "0.5 deg/s" }\nacceleration = { bias = "20 mm/s^2" }\n')
    at_first = np.array([readings(stage, robot) for robot in range(400)])
    for values, spread in zip(at_first.T[:3], (0.5, 20.0, 20.0), strict=True):
        assert values.mean() == pytest.approx(0.0, abs=4.0 * spread / 20.0)
        assert values.std() == pytest.approx(spread, rel=4.0 / math.sqrt(800.0))
    stage.advance(10.0, 2.0)
    later = np.array([readings(stage, robot) for robot in range(400)])
    assert later[:, :3] == pytest.approx(at_first[:, :3], abs=1e-9)
    assert (later[:, 3] + 180.0) % 360.0 - 180.0 == pytest.approx(10.0 * at_first[:, 0])


@pytest.mark.thorough
@pytest.mark.parametrize("minutes", [1, 4])
def test_a_bias_drifts_with_the_root_of_the_time(minutes: int) -> None:
    stage = fleet('turn = { drift = "0.5 deg/s" }\n')
    stage.advance(60.0 * minutes, 5.0)
    rates = np.array([stage.read("Imu", "turn_rate", robot) for robot in range(400)])
    assert rates.mean() == pytest.approx(0.0, abs=4.0 * 0.5 * math.sqrt(minutes) / 20.0)
    assert rates.std() == pytest.approx(0.5 * math.sqrt(minutes), rel=4.0 / math.sqrt(800.0))


def test_what_it_reads_depends_on_the_world_and_the_seed_alone() -> None:
    errors = NOISE.replace('" }', '", bias = "0.1 deg/s", drift = "0.1 deg/s" }', 1)
    often, once, other = (Stage(errors, seed=seed) for seed in (3, 3, 4))
    for stage in (often, once, other):
        stage.world.command(0, 300.0, 20.0)
        for _ in range(60):
            stage.world.advance(0.05)
            if stage is often:
                readings(stage)
    assert readings(often) == readings(once)
    assert readings(other)[3] != readings(once)[3]
