from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.nav.mapping.himm import HimmParameters, LocalPose
from colony.nav.mapping.local_map import ScanTrail, pose_after, relative_pose
from colony.nav.pose.pose import OdometryStep
from tests.nav.sonars import CHANNELS

coordinates = st.floats(-5_000.0, 5_000.0)
local_poses = st.builds(LocalPose, coordinates, coordinates, st.floats(-3.0, 3.0))


def test_steps_are_taken_in_the_frame_of_the_robot() -> None:
    at = pose_after(LocalPose(0.0, 0.0, math.radians(90.0)), OdometryStep(100.0, 20.0, 0.5))
    assert at == pytest.approx((-20.0, 100.0, math.radians(90.0) + 0.5))


@given(origin=local_poses, pose=local_poses)
def test_seen_from_undoes_a_step(origin: LocalPose, pose: LocalPose) -> None:
    assert pose_after(origin, OdometryStep(*relative_pose(origin, pose))) == pytest.approx(pose, abs=1e-6)


def hallway_scan(left_mm: float, heading_rad: float) -> np.ndarray:
    """What is read between two walls 2.4 m apart, the robot off to the left of the middle by so much."""
    ranges = np.full(CHANNELS, 10_000.0)
    bearings = (np.arange(CHANNELS) - 12) * math.radians(15.0) + heading_rad
    for wall in (1_200.0, -1_200.0):
        cosine = np.sin(bearings) * math.copysign(1.0, wall)
        near = cosine > math.cos(math.radians(8.0))
        ranges[near] = abs(wall - left_mm) - 360.0 * cosine[near]
    return ranges


@pytest.mark.parametrize("heading_deg", [0.0, 6.0, -11.0])
def test_a_trail_shows_the_walls_around_the_robot(heading_deg: float) -> None:
    """The robot goes on straight, at an angle to the hallway; it sees the hallway turned the other way."""
    trail, heading = ScanTrail(3_000.0), math.radians(heading_deg)
    for i in range(80):
        left = -200.0 + 25.0 * i * math.sin(heading)
        trail.add(OdometryStep(25.0, 0.0, 0.0), hallway_scan(left, heading))
    lines = trail.lines(HimmParameters(half_side_mm=7_000.0))
    assert len(lines) == 2
    across = sorted(line.distance_mm for line in lines)
    for line in lines:
        assert line.angle_deg == pytest.approx(-heading_deg, abs=1.5)
    assert across == pytest.approx([-1_200.0 - left, 1_200.0 - left], abs=70.0)


def test_a_trail_forgets_what_is_far_behind_and_keeps_little_of_who_stands() -> None:
    trail = ScanTrail(1_000.0)
    scan = np.full(CHANNELS, 10_000.0)
    for _ in range(100):
        trail.add(OdometryStep(0.0, 0.0, 0.0), scan)
    assert len(trail._scans) == 1
    for _ in range(100):
        trail.add(OdometryStep(70.0, 0.0, 0.0), scan)
    assert 900.0 <= trail.travel_mm <= 1_000.0
    assert len(trail._scans) == 15
    for _ in range(10):
        trail.add(OdometryStep(0.0, 0.0, math.radians(4.0)), scan)
    assert len(trail._scans) == 25
    trail.clear()
    assert trail.travel_mm == 0.0
