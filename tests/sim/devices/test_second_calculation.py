"""Devices held to a second calculation, from the true poses alone, that shares no code with them.

Robots drive for a while by random commands. What each device reads is then computed again, plainly: by sums
over the poses, by angles around a point, by points along a line of sight.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from colony.nav.maps.stickrep.model import Pose
from tests.sim.devices.stage import CHASSIS, MECANUM, Stage

SEEDS = pytest.mark.parametrize("seed", range(2))
GENTLE = ('"10 m/s^2"', '"1 m/s^2"'), ('"900 deg/s^2"', '"90 deg/s^2"')
STEP_S = 0.01


def gentle(chassis: str) -> str:
    """The same chassis with accelerations that steps of 10 ms resolve."""
    for old, new in GENTLE:
        chassis = chassis.replace(old, new)
    return chassis


def turned(degrees: float) -> float:
    """The same angle, at most half a turn."""
    return math.remainder(degrees, 360.0)


def driven(stage: Stage, seed: int, seconds: float = 12.0, *, sideways: bool = False) -> Iterator[Pose]:
    """Drive by random commands, new ones every half a second; yield each true pose, with the first."""
    rng = np.random.default_rng(seed)
    yield stage.world.true_pose(0)
    for step in range(round(seconds / STEP_S)):
        if step % 50 == 0:
            aside = rng.uniform(-300.0, 300.0) if sideways else 0.0
            stage.world.command(0, rng.uniform(-400.0, 800.0), rng.uniform(-80.0, 80.0), aside)
        stage.world.advance(STEP_S)
        yield stage.world.true_pose(0)


def moved(before: Pose, now: Pose) -> tuple[float, float, float]:
    """The way ahead and to the left, and the turn in rad, between two poses close to each other."""
    turn = math.radians(turned(now.heading_deg - before.heading_deg))
    middle = math.radians(before.heading_deg) + turn / 2.0
    dx, dy = now.x_mm - before.x_mm, now.y_mm - before.y_mm
    return dy * math.cos(middle) - dx * math.sin(middle), -dx * math.cos(middle) - dy * math.sin(middle), turn


# --- what adds up ----------------------------------------------------------------------------------


WHEELS = '[server.Wheels.simulated]\ndevice = "encoders"\n'


@SEEDS
def test_two_wheels_roll_as_the_poses_say(seed: int) -> None:
    stage = Stage(WHEELS, chassis=gentle(CHASSIS))
    poses = list(driven(stage, seed))
    ways = [moved(*pair) for pair in pairwise(poses)]
    left = sum(ahead - turn * 200.0 for ahead, _, turn in ways)
    right = sum(ahead + turn * 200.0 for ahead, _, turn in ways)
    assert stage.read("Wheels", "travel") == pytest.approx((left, right), abs=0.1)
    assert max(abs(aside) for _, aside, _ in ways) < 1e-3


@SEEDS
def test_four_wheels_roll_as_the_poses_say(seed: int) -> None:
    """Rollers at 45 degrees turn a way to the left into one ahead; 350 mm is the lever of a turn."""
    stage = Stage(WHEELS + "wheels = 4\n", chassis=gentle(MECANUM))
    poses = list(driven(stage, seed, sideways=True))
    ahead, aside, turn = (
        sum(column) for column in zip(*(moved(*pair) for pair in pairwise(poses)), strict=True)
    )
    lever = turn * 350.0
    expected = (ahead - aside - lever, ahead + aside + lever, ahead + aside - lever, ahead - aside + lever)
    assert stage.read("Wheels", "travel") == pytest.approx(expected, abs=0.1)


@SEEDS
def test_dead_reckoning_of_four_wheels_is_made_of_what_they_report(seed: int) -> None:
    errors = 'wheel_distance = "300 mm"\nscale_error = "2 percent"\nslip = "5 mm"'
    chassis = gentle(MECANUM.replace('wheel_distance = "300 mm"', errors))
    stage = Stage(WHEELS + "wheels = 4\n", chassis=chassis)
    x = y = heading = 0.0
    before = np.zeros(4)
    for _ in driven(stage, seed, sideways=True):
        now = np.array(stage.read("Wheels", "travel"))
        front_left, front_right, rear_left, rear_right = now - before
        before = now
        ahead = (front_left + front_right + rear_left + rear_right) / 4.0
        aside = (front_right + rear_left - front_left - rear_right) / 4.0
        turn = (front_right + rear_right - front_left - rear_left) / 4.0 / 350.0
        middle = heading + turn / 2.0
        x -= ahead * math.sin(middle) + aside * math.cos(middle)
        y += ahead * math.cos(middle) - aside * math.sin(middle)
        heading += turn
    odometry, true = stage.world.odometry(0), stage.world.true_pose(0)
    assert (odometry.x_mm, odometry.y_mm) == pytest.approx((x, y), abs=0.5)
    assert turned(odometry.heading_deg - math.degrees(heading)) == pytest.approx(0.0, abs=0.01)
    assert math.dist((x, y), (true.x_mm, true.y_mm)) > 5.0


@SEEDS
@pytest.mark.parametrize("chassis", [CHASSIS, MECANUM], ids=["differential", "mecanum"])
def test_accelerations_and_turn_rates_add_up_to_the_motion(seed: int, chassis: str) -> None:
    """The accelerations, turned by the heading, add up to the velocity; the turn rates add up to the turn."""
    stage = Stage('[server.Imu.simulated]\ndevice = "imu"\n', chassis=gentle(chassis))
    poses, velocity, turn = [], np.zeros(2), 0.0
    for pose in driven(stage, seed, sideways=chassis == MECANUM):
        poses.append(pose)
        if len(poses) == 1:
            continue
        fields = [
            stage.read("Imu", field) for field in ("acceleration", "sideways_acceleration", "turn_rate")
        ]
        ahead, aside, rate = (float(str(value)) for value in fields)
        angle = math.radians(poses[-2].heading_deg + turned(pose.heading_deg - poses[-2].heading_deg) / 2.0)
        forward = np.array([-math.sin(angle), math.cos(angle)])
        leftward = np.array([-math.cos(angle), -math.sin(angle)])
        velocity += (ahead * forward + aside * leftward) * STEP_S
        turn += rate * STEP_S
        way = np.array([pose.x_mm - poses[-2].x_mm, pose.y_mm - poses[-2].y_mm])
        assert np.abs(way / STEP_S - velocity).max() < 25.0, len(poses)
    whole = sum(turned(b.heading_deg - a.heading_deg) for a, b in pairwise(poses))
    assert turn == pytest.approx(whole, abs=1.0)
    assert turned(float(str(stage.read("Imu", "heading"))) - poses[-1].heading_deg) == pytest.approx(
        0.0, abs=1e-6
    )


@SEEDS
def test_a_compass_reads_the_true_heading_of_the_time_when_it_measured(seed: int) -> None:
    compass = '[server.Compass]\nrate = "5 Hz"\nsimulated = { device = "compass", offset = "-2 deg" }\n'
    stage = Stage(compass)
    headings = {}
    for pose in driven(stage, seed, 4.0):
        headings[stage.world.elapsed_ns] = pose.heading_deg
        taken = stage.time_of("Compass", "heading")
        assert taken is not None
        assert 0 <= stage.world.elapsed_ns - taken < 200_000_000
        error = float(str(stage.read("Compass", "heading"))) - headings[taken] + 2.0
        assert turned(error) == pytest.approx(0.0, abs=1e-9)
    assert len(set(headings.values())) > 200


WINCH = """
[server.Winch.simulated]
device  = "joint"
control = "velocity"
range   = "100 mm .. 300 mm"
speed   = "50 mm/s"
"""


@SEEDS
def test_a_joint_is_where_its_velocities_add_up_to(seed: int) -> None:
    stage, rng, position, velocity = Stage(WINCH), np.random.default_rng(seed), 100.0, 0.0
    at_ends = 0
    for step in range(2000):
        if step % 40 == 0:
            velocity = float(rng.choice([-1.0, 0.0, 1.0]) * rng.uniform(5.0, 90.0))
            stage.devices[0]["Winch"].command("run", {"velocity": velocity}, stage.world.elapsed_ns)
            velocity = min(max(velocity, -50.0), 50.0)
        stage.advance(0.05)
        position = min(max(position + velocity * 0.05, 100.0), 300.0)
        assert stage.read("Winch", "position") == pytest.approx(position, abs=1e-6)
        is_held = (position < 100.0 + 1e-6 and velocity <= 0.0) or (
            position > 300.0 - 1e-6 and velocity >= 0.0
        )
        at_ends += is_held
        assert stage.read("Winch", "velocity") == (0.0 if is_held else pytest.approx(velocity))
        assert stage.read("Winch", "moving") is (not is_held and velocity != 0.0)
    assert 0 < at_ends < 2000


# --- what is seen ----------------------------------------------------------------------------------


def ahead_of(pose: Pose, ahead: float, left: float) -> NDArray[np.float64]:
    """A place given in the frame of a robot."""
    heading = complex(math.cos(math.radians(pose.heading_deg)), math.sin(math.radians(pose.heading_deg)))
    place = complex(0.0, 1.0) * complex(ahead, left) * heading
    return np.array([pose.x_mm + place.real, pose.y_mm + place.imag])


EYE = """
[server.Eye.simulated]
device = "dock_sensor"
pose   = ["200 mm", "100 mm", "30 deg"]
range  = "3 m"
view   = "120 deg"
"""


def crosses(wall: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]) -> bool:
    """True if a wall crosses the line from `start` to `end`: both are cut between their ends."""
    across = np.column_stack([end - start, wall[:2] - wall[2:]])
    along, up = np.linalg.solve(across, wall[:2] - start)
    return bool(0.0 < along < 1.0 and 0.0 <= up <= 1.0)


@SEEDS
def test_the_dock_that_is_seen_is_the_nearest_in_view_without_a_wall_between(seed: int) -> None:
    rng = np.random.default_rng(seed)
    walls = rng.uniform(-3000.0, 3000.0, (6, 4)) + np.array([4000.0, 0.0, 4000.0, 0.0])
    docks = rng.uniform(-3000.0, 3000.0, (6, 2)) + np.array([4000.0, 0.0])
    stage = Stage(EYE, walls=walls, poses=[(-2000.0, 0.0, 0.0)], docks=[(x, y, 0.0) for x, y in docks])
    counts = {False: 0, True: 0}
    for _ in range(300):
        placed = Pose(*rng.uniform((1500.0, -3000.0, 0.0), (7000.0, 3000.0, 360.0)).tolist())
        try:
            stage.world.place(0, tuple(placed))
        except ValueError:  # it would stand in a wall
            continue
        stage.world.advance(STEP_S)
        pose = stage.world.true_pose(0)
        eye = ahead_of(pose, 200.0, 100.0)
        best: tuple[float, float, float] | None = None
        for dock in docks:
            away = math.dist(dock, eye)
            direction = math.degrees(math.atan2(*(eye - dock)[:1], *(dock - eye)[1:]))
            is_seen = away <= 3000.0 and abs(turned(direction - pose.heading_deg - 30.0)) <= 60.0
            if (
                is_seen
                and not any(crosses(wall, eye, dock) for wall in walls)
                and (best is None or away < best[0])
            ):
                center = np.array([pose.x_mm, pose.y_mm])
                bearing = math.degrees(math.atan2(*(center - dock)[:1], *(dock - center)[1:]))
                best = (away, math.dist(dock, center), turned(bearing - pose.heading_deg))
        counts[best is not None] += 1
        assert stage.read("Eye", "dock_seen") is (best is not None)
        if best is None:
            assert stage.read("Eye", "dock_distance") is stage.read("Eye", "dock_bearing") is None
        else:
            assert stage.read("Eye", "dock_distance") == pytest.approx(best[1], abs=1e-6)
            assert stage.read("Eye", "dock_bearing") == pytest.approx(best[2], abs=1e-6)
    assert min(counts.values()) > 30


CLIFF = '[server.Floor.simulated]\ndevice = "cliff"\nplaces = [["250 mm", "120 mm"], ["-200 mm", "-90 mm"]]\n'


def is_around(polygon: NDArray[np.float64], place: NDArray[np.float64]) -> bool:
    """True if a polygon winds around a place: the angles between its corners, seen from there, are a turn."""
    angles = np.degrees(np.arctan2(*(polygon - place).T[::-1]))
    return abs(sum(turned(b - a) for a, b in zip(angles, np.roll(angles, -1), strict=True))) > 180.0


@SEEDS
def test_a_cliff_sensor_sees_the_edges_of_holes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    holes = []
    for x in (-1500.0, 0.0, 1500.0):
        angles = np.sort(rng.uniform(0.0, math.tau, 7))
        radii = rng.uniform(200.0, 900.0, 7)
        holes.append(np.column_stack([x + radii * np.cos(angles), 600.0 + radii * np.sin(angles)]))
    stage = Stage(CLIFF, holes=[[tuple(corner) for corner in hole.tolist()] for hole in holes])
    counts = {False: 0, True: 0}
    for step, pose in enumerate(driven(stage, seed, 20.0)):
        if step % 5:
            continue
        expected = tuple(
            any(is_around(hole, ahead_of(pose, *place)) for hole in holes)
            for place in ((250.0, 120.0), (-200.0, -90.0))
        )
        assert stage.read("Floor", "cliff") == expected
        for each in expected:
            counts[each] += 1
    assert min(counts.values()) > 50
