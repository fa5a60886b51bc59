"""The sonars and infrared detectors against closed forms, with a robot that measures without noise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from colony.sim.config import RobotConfig
from colony.sim.sensors.sonar import RAY_STEP_DEG, corner_reflectors, fan_of, wall_table
from colony.sim.world.world import World
from tests.sim.robots import IDEAL, ROME, with_ring
from tests.sim.robots import RING as TRANSDUCERS

RING = TRANSDUCERS.ring_mm
FULL = TRANSDUCERS.sonar_range_mm
FAR = 100_000.0

Walls = list[tuple[float, float, float, float]]


def world(
    walls: Walls, heading: float = 0.0, config: RobotConfig = IDEAL, x: float = 0.0, y: float = 0.0
) -> World:
    return World(walls=walls, poses=[(x, y, heading)], config=config)


def wall_at(bearing: float, distance: float) -> tuple[float, float, float, float]:
    """A very long wall whose nearest point is seen from the origin in this direction, in world degrees."""
    angle = math.radians(bearing)
    nx, ny = -math.sin(angle), math.cos(angle)
    x, y = distance * nx, distance * ny
    return (x - FAR * ny, y + FAR * nx, x + FAR * ny, y - FAR * nx)


@pytest.mark.parametrize("heading", [0.0, 37.0, 90.0, 180.0, 271.5])
@pytest.mark.parametrize(("bearing", "channel"), [(0, 12), (90, 18), (180, 0), (270, 6), (15, 13), (345, 11)])
def test_channels_count_counterclockwise_with_12_ahead(heading: float, bearing: float, channel: int) -> None:
    readings = world([wall_at(heading + bearing, 2_000.0)], heading).sonar(0)
    assert int(readings.argmin()) == channel
    assert readings[channel] == pytest.approx(2_000.0 - RING)


def test_nothing_in_range_reads_the_full_range() -> None:
    assert (world([]).sonar(0) == FULL).all()
    assert (world([wall_at(0.0, FULL + RING + 1.0)]).sonar(0) == FULL).all()
    assert world([wall_at(0.0, FULL + RING - 1.0)]).sonar(0)[12] == pytest.approx(FULL - 1.0)


@pytest.mark.parametrize("angle", [0.0, 3.0, 6.0, 9.0, 12.0])
def test_a_wall_whose_normal_is_in_the_cone_is_read_at_its_nearest_point(angle: float) -> None:
    reading = world([wall_at(angle, 3_000.0)]).sonar(0)[12]
    assert reading == pytest.approx(3_000.0 - RING * math.cos(math.radians(angle)))


@pytest.mark.parametrize("angle", [1.5, 4.5, 10.5])
def test_between_two_rays_a_wall_is_read_too_far_by_very_little(angle: float) -> None:
    reading = world([wall_at(angle, 3_000.0)]).sonar(0)[12]
    exact = 3_000.0 - RING * math.cos(math.radians(angle))
    assert exact <= reading <= exact * 1.0004


@pytest.mark.parametrize("angle", [15.0, 20.0, 30.0, 41.9])
def test_an_oblique_wall_is_heard_by_the_edge_of_the_cone(angle: float) -> None:
    height = 3_000.0 - RING * math.cos(math.radians(angle))
    reading = world([wall_at(angle, 3_000.0)]).sonar(0)[12]
    assert reading == pytest.approx(height / math.cos(math.radians(angle - 12.0)))


@pytest.mark.parametrize("angle", [42.1, 50.0, 60.0, 80.0])
def test_beyond_the_critical_angle_a_wall_is_not_heard(angle: float) -> None:
    assert world([wall_at(angle, 3_000.0)]).sonar(0)[12] == FULL


def test_a_wall_that_is_not_heard_hides_what_is_behind() -> None:
    mirror = (-2_000.0, 500.0, 2_000.0, 4_500.0)  # at 45 degrees across the way ahead
    behind = wall_at(0.0, 6_000.0)
    assert world([behind]).sonar(0)[12] == pytest.approx(6_000.0 - RING)
    assert world([mirror, behind]).sonar(0)[12] == FULL


def test_something_else_in_the_cone_returns_the_echo() -> None:
    mirror = (-2_000.0, 500.0, 2_000.0, 4_500.0)
    post = (-180.0, 1_900.0, -140.0, 1_900.0)  # in front of the mirror, six degrees off the axis
    assert world([mirror, post]).sonar(0)[12] == pytest.approx((1_900.0 - RING) / math.cos(math.radians(6.0)))


def test_a_narrow_beam_hears_only_its_axis() -> None:
    narrow = with_ring(IDEAL, sonar_half_beam_deg=0.0)
    post = (-300.0, 1_900.0, -100.0, 1_900.0)
    assert world([post]).sonar(0)[12] < 2_000.0
    assert world([post], config=narrow).sonar(0)[12] == FULL


CORNER: Walls = [(2_000.0, -FAR, 2_000.0, 2_000.0), (2_000.0, 2_000.0, -FAR, 2_000.0)]


def test_a_right_angled_corner_is_heard_from_inside() -> None:
    # Both walls are met at 45 degrees, far beyond the critical angle; the corner sends the sound back.
    assert world(CORNER).sonar(0)[9] == pytest.approx(math.hypot(2_000.0, 2_000.0) - RING)
    assert world(CORNER[::-1]).sonar(0)[9] == pytest.approx(math.hypot(2_000.0, 2_000.0) - RING)
    flipped = [(c, d, a, b) for a, b, c, d in CORNER]
    assert world(flipped).sonar(0)[9] == pytest.approx(math.hypot(2_000.0, 2_000.0) - RING)


def test_the_outside_of_a_corner_is_not_heard() -> None:
    outside = world(CORNER, x=4_000.0, y=4_000.0, heading=135.0)  # looking straight at the corner
    assert outside.sonar(0)[12] == FULL


def test_corners_reflect_on_their_inner_side_only() -> None:
    left_turn = np.array([(0.0, 0.0, 10.0, 0.0), (10.0, 0.0, 10.0, 10.0)])
    assert corner_reflectors(wall_table(left_turn)).tolist() == [
        [False, True, False, False],
        [True, False, False, False],
    ]
    straight = np.array([(0.0, 0.0, 10.0, 0.0), (10.0, 0.0, 20.0, 0.0)])
    assert not corner_reflectors(wall_table(straight)).any()


def test_another_robot_is_seen_and_hides_the_wall() -> None:
    wall = wall_at(0.0, 5_000.0)
    two = World(walls=[wall], poses=[(0.0, 0.0, 0.0), (0.0, 3_000.0, 0.0)], config=IDEAL)
    assert two.sonar(0)[12] == pytest.approx(3_000.0 - IDEAL.radius_mm - RING)
    assert two.sonar(1)[0] == pytest.approx(3_000.0 - IDEAL.radius_mm - RING)
    assert two.sonar(1)[12] == pytest.approx(2_000.0 - RING)


def test_another_robot_behind_a_wall_is_not_seen() -> None:
    wall = wall_at(0.0, 1_500.0)
    two = World(walls=[wall], poses=[(0.0, 0.0, 0.0), (0.0, 3_000.0, 0.0)], config=IDEAL)
    assert two.sonar(0)[12] == pytest.approx(1_500.0 - RING)


def test_rays_do_not_slip_between_walls_that_meet() -> None:
    rng = np.random.default_rng(7)
    axis_only = with_ring(IDEAL, sonar_half_beam_deg=0.0, sonar_critical_deg=90.0)
    for _ in range(200):
        # A closed polygon around the robot with a node exactly ahead of each transducer.
        heading = float(rng.uniform(0.0, 360.0))
        angles = np.radians(heading + np.arange(24) * 15.0)
        nodes = 2_000.0 * np.stack([-np.sin(angles), np.cos(angles)], axis=-1)
        walls = np.hstack([nodes, np.roll(nodes, -1, axis=0)])
        readings = World(walls=walls, poses=[(0.0, 0.0, heading)], config=axis_only).sonar(0)
        assert readings == pytest.approx(np.full(24, 2_000.0 - RING))


def test_nothing_reads_less_than_the_least_range() -> None:
    near = world([wall_at(0.0, IDEAL.radius_mm)])
    assert near.sonar(0)[12] == TRANSDUCERS.sonar_min_mm


@pytest.mark.parametrize(
    ("gap", "seen"),
    [(TRANSDUCERS.infrared_range_mm - 1.0, True), (TRANSDUCERS.infrared_range_mm + 1.0, False)],
)
def test_infrared_sees_what_is_near_on_its_axis(gap: float, seen: bool) -> None:
    expected = np.zeros(24, dtype=bool)
    expected[18] = seen
    assert (world([wall_at(90.0, RING + gap)]).infrared(0) == expected).all()


def test_infrared_sees_mirrors_too() -> None:
    mirror = (-2_000.0, -1_200.0, 2_000.0, 2_800.0)
    assert world([mirror]).sonar(0)[12] == FULL
    assert world([mirror]).infrared(0)[12]


def test_only_wired_detectors_see() -> None:
    eight = with_ring(IDEAL, infrared_wired=(9, 10, 11, 12, 13, 14, 15, 0))
    around = [wall_at(bearing, 800.0) for bearing in range(0, 360, 15)]
    assert world(around).infrared(0).all()
    assert np.flatnonzero(world(around, config=eight).infrared(0)).tolist() == [0, 9, 10, 11, 12, 13, 14, 15]


def test_noise_has_the_deviation_that_the_robot_says() -> None:
    noisy = with_ring(ROME, sonar_noise_mm=5.0, sonar_noise=0.002)
    one = World(walls=[wall_at(0.0, 3_000.0)], poses=[(0.0, 0.0, 0.0)], config=noisy, seed=5)
    readings, silent = [], []
    for _ in range(2_000):
        one.advance(0.05)
        readings.append(one.sonar(0)[12])
        silent.append(one.sonar(0)[0])
    reach = 3_000.0 - RING
    deviation = 5.0 + 0.002 * reach
    assert np.mean(readings) == pytest.approx(reach, abs=4 * deviation / math.sqrt(2_000))
    assert np.std(readings) == pytest.approx(deviation, rel=0.07)
    assert set(silent) == {FULL}


@pytest.mark.parametrize("half_beam_deg", [0.0, 1.0, 9.0, 10.0, 12.0, 14.5, 40.0])
def test_a_cone_is_as_wide_as_the_config_says(half_beam_deg: float) -> None:
    fan = fan_of(replace(TRANSDUCERS, sonar_half_beam_deg=half_beam_deg))
    ahead = np.degrees(np.arctan2(fan.ray_v[12], fan.ray_u[12]))
    assert (ahead[0], ahead[-1]) == pytest.approx((-half_beam_deg, half_beam_deg))
    assert ahead[len(ahead) // 2] == 0.0
    assert (np.diff(ahead) <= RAY_STEP_DEG + 1e-9).all()
