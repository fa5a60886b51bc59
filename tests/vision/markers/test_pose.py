"""The place of a camera before a marker, and the measurements of the pose."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from colony.nav.maps.signs import MARKER_CODES, Marker
from colony.nav.maps.stickrep.geometry import Point
from colony.runtime.library.robot import Position
from colony.vision.level_camera import SIDE
from colony.vision.markers.rows import MarkerPose, find_markers, marker_pose, marker_rows
from tests.vision.markers.views import View, picture

MARKER = Marker(edge=0, start_mm=0, end_mm=622, center=Point(5_000, 8_000), heading_deg=90, node="E", code=0)


def look(number: int, chance: random.Random) -> tuple[MarkerPose, tuple[float, float, float]]:
    """A picture's pose, and what it should be."""
    distance, bearing = chance.uniform(900, 2_000), math.radians(chance.uniform(-6, 6))
    facing = chance.uniform(-35.0, 35.0)
    view = View(
        code=MARKER_CODES[number % 5],
        ahead_mm=distance * math.cos(bearing),
        right_mm=-distance * math.sin(bearing),
        facing_deg=facing,
        noise=3.0,
    )
    [box] = find_markers(picture(view, seed=number))
    pose = marker_pose(box)
    assert pose is not None
    return pose, (math.degrees(bearing), distance, facing)


def test_one_look_tells_bearing_distance_and_facing_as_well_as_it_says() -> None:
    chance = random.Random(2)
    off = []
    for number in range(60):
        pose, true = look(number, chance)
        errors = [found - wanted for found, wanted in zip(pose[:3], true, strict=True)]
        assert abs(errors[0]) < 0.2
        assert abs(errors[1]) < 0.02 * true[1]
        assert abs(errors[2]) < 2.0
        off.append([error / sigma for error, sigma in zip(errors, pose[3:], strict=True)])
    spread = np.sqrt(np.mean(np.square(off), axis=0))
    assert (spread < 1.0).all(), spread  # the sigmas leave room for lenses that are not ideal


def test_who_is_to_the_left_of_the_doors_middle_sees_it_to_the_right() -> None:
    [box] = find_markers(picture(View(code=0, right_mm=150.0, ahead_mm=1_200.0)))
    pose = marker_pose(box)
    assert pose.bearing_deg < 0.0
    assert pose.aside_mm == pytest.approx(150.0, abs=15.0)
    assert pose.ahead_mm == pytest.approx(1_200.0, abs=15.0)


def test_a_camera_that_looks_aside_tells_it_from_ahead() -> None:
    [box] = find_markers(picture(View(code=0, right_mm=0.0)))
    pose = marker_pose(box, SIDE)
    assert pose.bearing_deg == pytest.approx(90.0, abs=0.2)
    assert pose.facing_deg == pytest.approx(90.0, abs=1.0)


def test_a_box_without_its_edges_is_nowhere() -> None:
    [box] = find_markers(picture(View(code=0)))
    assert marker_pose(box._replace(edges=())) is None
    assert marker_pose(box._replace(edges=box.edges[:-1])) is None
    assert marker_pose(box._replace(edges=(100.0,) * 8)) is None


# --- the fix ---------------------------------------------------------------------------------------------


def seen_from(x: float, y: float, heading: float, facing_sigma_deg: float = 0.5) -> MarkerPose:
    """What a camera sees of MARKER from a pose, without any error."""
    east, north = MARKER.center.x - x, MARKER.center.y - y
    bearing = math.remainder(math.degrees(math.atan2(-east, north)) - heading, 360.0)
    facing = math.remainder(MARKER.heading_deg - heading, 360.0)
    return MarkerPose(bearing, math.hypot(east, north), facing, 0.2, 12.0, facing_sigma_deg)


@pytest.mark.parametrize("turn", [0.0, 360.0])
def test_the_rows_hold_for_the_true_pose(turn: float) -> None:
    true = (6_150.0, 8_060.0, 83.0 + turn)
    believed = Position(x=6_190.0, y=8_030.0, heading=85.0, t_ns=0)
    rows = marker_rows(seen_from(*true), MARKER, believed)
    assert len(rows) == 3
    for row in rows:
        heading = math.radians(true[2] - turn)
        predicted = row.cx * true[0] + row.cy * true[1] + row.ch * heading
        assert abs(predicted - row.value) < 0.7 * row.sigma, row
        wrong = row.cx * believed.x + row.cy * believed.y + row.ch * math.radians(believed.heading)
        assert abs(wrong - row.value) > 2.0 * row.sigma, row


def test_from_far_only_the_bearing_is_told() -> None:
    believed = Position(x=9_000.0, y=8_000.0, heading=90.0, t_ns=0)
    [row] = marker_rows(seen_from(9_000.0, 8_000.0, 90.0, facing_sigma_deg=4.0), MARKER, believed)
    assert row.ch == -1.0
