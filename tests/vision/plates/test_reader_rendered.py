"""The reader on plates of a building as the simulator's side camera sees them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from colony.nav.maps.signs import PLATE_HEIGHT_MM, PLATE_WIDTH_MM, SIGN_HEIGHT_MM, plates_of
from colony.sim.cameras.camera import Camera
from colony.sim.cameras.scene import scene_of
from colony.sim.world.world import Speed
from colony.vision.detections import Corner, PlateBox
from colony.vision.level_camera import SIDE
from colony.vision.plates.reader import read_plate
from tests.buildings import MSU
from tests.sim.robots import FRONT_CAMERA

FLOOR = MSU
PLATES = plates_of(FLOOR)
NOBODY = np.zeros((0, 2))


@pytest.fixture(scope="module")
def camera() -> Camera:
    return Camera(scene_of(FLOOR), replace(FRONT_CAMERA, yaw_deg=SIDE.yaw_deg), robot_radius_mm=400.0, seed=1)


def _box(distance_mm: float, tilt_deg: float) -> PlateBox:
    """Where the plate is in the image of a camera that stands before its middle and is turned a little."""
    turn = math.radians(tilt_deg)
    corners: list[Corner] = []
    for across, up in ((-1, 1), (1, 1), (1, -1), (-1, -1)):
        side = across * PLATE_WIDTH_MM / 2.0
        depth = distance_mm * math.cos(turn) - side * math.sin(turn)
        column = SIDE.column_of(math.degrees(math.atan2(side, distance_mm)) * -1.0 - tilt_deg)
        corners.append((column, SIDE.row_of(SIGN_HEIGHT_MM + up * PLATE_HEIGHT_MM / 2.0, depth)))
    a, b, c, d = corners
    return PlateBox((a, b, c, d), 1.0)


@pytest.mark.parametrize("distance_mm", [900.0, 1_300.0, 1_800.0, 2_200.0])
def test_plates_of_the_building_are_read(camera: Camera, distance_mm: float) -> None:
    random = np.random.default_rng(3)
    wrong: list[tuple[str, str]] = []
    for i, plate in enumerate(PLATES[::6]):
        into = math.radians(plate.heading_deg)
        x = plate.center.x + distance_mm * math.sin(into)
        y = plate.center.y - distance_mm * math.cos(into)
        tilt = float(random.uniform(-12.0, 12.0))
        pose = np.array([[x, y, plate.heading_deg - 90.0 + tilt]])
        image = camera.image(pose, 0, i * 10**9, people=NOBODY, speed=Speed(400.0, 0.0))
        reading = read_plate(image, _box(distance_mm, tilt))
        if reading.text != plate.text:
            wrong.append((plate.text, reading.text))
    assert len(PLATES[::6]) >= 18
    assert len(wrong) <= 1, wrong
