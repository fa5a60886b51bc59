"""The geometry of level cameras held against what the simulator's cameras render."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from colony.nav.maps.signs import Marker, Plate, markers_of, plates_of
from colony.nav.maps.stickrep.reader import load_map
from colony.sim.cameras.camera import Camera
from colony.sim.cameras.optics import Optics
from colony.sim.cameras.scene import scene_of
from colony.vision.level_camera import AHEAD
from colony.vision.signs_in_view import corners_of, signs_in_view
from tests.buildings import LOOP, MSU
from tests.paths import MAPS
from tests.sim.robots import FRONT_CAMERA

OPTICS = Optics(blur=0.0, noise=0.0, vignetting=0.0, gain=0.0, exposure_s=0.0)
NARROW = load_map(MAPS / "narrow.stickrep")
SIZES = [(240, 120), (640, 480)]


def before(
    sign: Plate | Marker, *, away: float, aside: float, turned: float, yaw: float
) -> tuple[float, float, float]:
    """A pose from which the camera sees a sign: so far from the wall, so far to the right of its middle."""
    angle = math.radians(sign.heading_deg)
    x = sign.center.x + away * math.sin(angle) + aside * math.cos(angle)
    y = sign.center.y - away * math.cos(angle) + aside * math.sin(angle)
    return x, y, (sign.heading_deg - yaw + turned) % 360.0


def crossings(levels: NDArray[np.float64], start: float, end: float) -> tuple[float, float]:
    """Where levels fall below half of what they are outside, near `start`, and rise again near `end`."""
    first, last = round(start), round(end)
    outside = (levels[first - 5 : first - 2].mean() + levels[last + 3 : last + 6].mean()) / 2
    inside = min(levels[first + 1 : first + 4].min(), levels[last - 3 : last].min())
    dark = (levels < (outside + inside) / 2).astype(int)
    low = int(np.flatnonzero(dark[first - 3 :])[0]) + first - 3
    high = int(np.flatnonzero(dark[: last + 4])[-1])
    half = (outside + inside) / 2
    left = low - (half - levels[low]) / (levels[low - 1] - levels[low])
    right = high + (half - levels[high]) / (levels[high + 1] - levels[high])
    return float(left), float(right)


@pytest.mark.parametrize("size", SIZES, ids=lambda size: "x".join(map(str, size)))
@pytest.mark.parametrize(("aside", "turned"), [(0.0, 0.0), (350.0, 0.0), (-200.0, 6.0), (250.0, -9.0)])
@pytest.mark.parametrize("yaw", [0.0, 90.0])
def test_a_plate_is_rendered_where_its_corners_are(
    size: tuple[int, int], aside: float, turned: float, yaw: float
) -> None:
    columns, rows = size
    camera = replace(AHEAD, columns=columns, rows=rows, yaw_deg=yaw)
    eye = Camera(
        scene_of(MSU),
        replace(FRONT_CAMERA, width=columns, height=rows, yaw_deg=yaw, optics=OPTICS),
        robot_radius_mm=400.0,
    )
    for plate in plates_of(MSU)[:4]:  # on painted brick
        pose = before(plate, away=1200.0, aside=aside, turned=turned, yaw=yaw)
        corners = corners_of(plate, pose, camera)
        assert corners is not None
        image = eye.image(np.array([pose]), 0).astype(float)
        (left, top), (right, right_top), (_, right_bottom), (_, bottom) = corners
        row = image[(rows - 1) // 2 + np.array([-4, 4]) * rows // 120].mean(axis=0)
        assert crossings(row, left, right) == pytest.approx((left, right), abs=0.35)
        for column in (left + 3.0, right - 3.0):
            inside = round(column)
            share = (inside - left) / (right - left)
            expected = (top + share * (right_top - top), bottom + share * (right_bottom - bottom))
            assert crossings(image[:, inside], *expected) == pytest.approx(expected, abs=0.5)


def test_markers_too_are_where_they_are_said_to_be() -> None:
    camera, eye = AHEAD, Camera(scene_of(MSU), replace(FRONT_CAMERA, optics=OPTICS), robot_radius_mm=400.0)
    for marker in markers_of(MSU):
        pose = before(marker, away=1700.0, aside=150.0, turned=7.0, yaw=0.0)
        corners = corners_of(marker, pose, camera)
        assert corners is not None
        image = eye.image(np.array([pose]), 0).astype(float)
        assert crossings(image[60], corners[0][0], corners[1][0]) == pytest.approx(
            (corners[0][0], corners[1][0]), abs=0.4
        )


def test_what_is_in_view_is_there_and_nothing_else() -> None:
    camera = replace(AHEAD, yaw_deg=90.0)
    for floor in (LOOP, MSU, NARROW):
        for plate in plates_of(floor)[::7]:
            pose = before(plate, away=800.0, aside=0.0, turned=0.0, yaw=90.0)
            seen = signs_in_view(floor, pose, camera)
            assert seen[0].sign == plate
            assert seen[0].distance_mm == pytest.approx(800.0)
            assert list(seen) == sorted(seen, key=lambda one: one.distance_mm)
            turned = (pose[0], pose[1], pose[2] + 180.0)
            assert plate not in [one.sign for one in signs_in_view(floor, turned, camera)]


def test_walls_hide_signs_and_backs_show_none() -> None:
    plate = plates_of(MSU)[3]
    behind = before(plate, away=-900.0, aside=0.0, turned=180.0, yaw=0.0)
    assert corners_of(plate, behind, AHEAD) is None
    far = before(plate, away=9000.0, aside=0.0, turned=0.0, yaw=0.0)
    assert corners_of(plate, far, AHEAD) is not None
    assert plate not in [one.sign for one in signs_in_view(MSU, far, AHEAD)]
