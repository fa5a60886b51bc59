"""What a simulated camera sees, held against projections computed by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from colony.sim.camera import Camera, CameraConfig
from colony.sim.scene import CEILING_MM, Panel, Scene, scene, scene_of
from tests.sim.buildings import HALLWAY

ROOM = [
    [-3000.0, -3000.0, -3000.0, 3000.0],
    [-3000.0, 3000.0, 3000.0, 3000.0],
    [3000.0, 3000.0, 3000.0, -3000.0],
    [3000.0, -3000.0, -3000.0, -3000.0],
]
EYE = 1350.0
FOCAL = 120.0 / math.tan(math.radians(30.0))


def see(
    made: Scene, *poses: tuple[float, float, float], robot: int = 0, **options: float
) -> NDArray[np.uint8]:
    camera = Camera(made, CameraConfig(**options), robot_radius_mm=400.0)  # type: ignore[arg-type]
    return camera.image(np.array(poses), robot)


def edges(column: NDArray[np.uint8], least: int = 12) -> list[int]:
    """The rows where a column changes suddenly."""
    return (np.flatnonzero(np.abs(np.diff(column.astype(int))) >= least) + 1).tolist()


def row_of(height_mm: float, depth_mm: float) -> int:
    """The first row below a height at a depth."""
    return math.ceil(59.5 - FOCAL * (height_mm - EYE) / depth_mm)


def test_a_wall_ends_where_projection_says() -> None:
    image = see(scene(ROOM), (0.0, -2000.0, 0.0))
    assert (image.shape, image.dtype) == ((120, 240), np.uint8)
    for column in (0, 120, 239):  # a wall that is faced ends at the same rows in every column
        top, bottom = edges(image[:, column])[0], edges(image[:, column])[-1]
        assert (top, bottom) == (row_of(CEILING_MM, 5000.0), row_of(0.0, 5000.0))
        wall = image[top:bottom, column]
        assert wall.min() == wall.max()


def test_panels_are_where_projection_says() -> None:
    made = scene(ROOM, [Panel(1, 2000.0, 3000.0, 0.0, 2000.0, 0.1)])
    image = see(made, (0.0, -2000.0, 0.0))
    dark = image[60] < 60
    assert dark.sum() == round(1000.0 / 5000.0 * FOCAL)
    assert np.flatnonzero(dark)[-1] == 119  # it ends straight ahead, and is on the left of that
    assert row_of(2000.0, 5000.0) in edges(image[:, 110])


def test_the_left_wall_is_on_the_left_and_yaw_counts_counterclockwise() -> None:
    made = scene(ROOM, [Panel(0, 0.0, 6000.0, 0.0, CEILING_MM, 0.0)])  # the west wall is black
    ahead = see(made, (0.0, 0.0, 0.0), view_deg=120.0)
    assert (ahead[60, :20] == 0).all()
    assert (ahead[60, 120:] > 0).all()
    assert (see(made, (0.0, 0.0, 0.0), yaw_deg=90.0)[60] == 0).all()
    turned = see(made, (0.0, 0.0, 90.0))
    assert (turned == see(made, (0.0, 0.0, 0.0), yaw_deg=90.0)).all()


def test_what_is_far_is_darker_and_corners_show() -> None:
    made = scene(ROOM)
    near, far = (see(made, (0.0, y, 0.0))[60, 120] for y in (1000.0, -2500.0))
    assert near > far
    corner = see(made, (0.0, 0.0, 0.0), yaw_deg=45.0)[60].astype(int)
    assert np.abs(np.diff(corner)).argmax() == 119


def test_another_robot_hides_what_is_behind_it() -> None:
    made = scene(ROOM)
    alone = see(made, (0.0, -2500.0, 0.0))
    image = see(made, (0.0, -2500.0, 0.0), (0.0, 0.0, 0.0))
    changed = (image != alone).any(axis=0)
    half_width = math.asin(400.0 / 2500.0)
    assert changed.sum() == pytest.approx(2.0 * FOCAL * math.tan(half_width), abs=2.0)
    assert changed[119]
    top = row_of(1000.0, 2100.0)
    assert (image[top + 1 : row_of(0.0, 2100.0), 120] < 100).all()
    assert (image[: row_of(1000.0, 2900.0), 120] == alone[: row_of(1000.0, 2900.0), 120]).all()
    nearer = see(made, (0.0, -2500.0, 0.0), (0.0, -1000.0, 0.0), (0.0, 0.0, 0.0))
    other_order = see(made, (0.0, -2500.0, 0.0), (0.0, 0.0, 0.0), (0.0, -1000.0, 0.0))
    assert (nearer == other_order).all()
    assert (nearer != image).any()


def test_a_robot_sees_neither_itself_nor_what_is_behind_a_wall() -> None:
    made = scene([*ROOM, [-3000.0, -1000.0, 3000.0, -1000.0]])
    alone = see(made, (0.0, -2500.0, 0.0))
    assert (see(made, (0.0, 1000.0, 0.0), (0.0, -2500.0, 0.0), robot=1) == alone).all()


def test_a_building_without_walls_has_a_floor_and_a_ceiling() -> None:
    image = see(scene([]), (0.0, 0.0, 0.0))
    assert image[0].min() > image[119].max() > 0
    assert see(scene([]), (0.0, 0.0, 0.0), height=121).shape == (121, 240)


def test_no_light_leaks_where_walls_meet() -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 200)
    ring = 2000.0 * np.column_stack([np.sin(angles), np.cos(angles)])
    ring[-1] = ring[0]
    made = scene(np.hstack([ring[:-1], ring[1:]]))
    for heading in range(0, 360, 7):
        image = see(made, (13.0, -7.0, float(heading)), height=2, width=2000)
        assert image.min() > 100


def test_the_same_place_gives_the_same_image() -> None:
    camera = Camera(scene_of(HALLWAY), CameraConfig(), robot_radius_mm=400.0)
    x, y, heading = HALLWAY.start
    here, there = np.array([[x, y, heading]]), np.array([[x + 100.0, y, heading + 5.0]])
    first = camera.image(here, 0)
    other = camera.image(there, 0)
    assert (first != other).any()
    assert (camera.image(here, 0) == first).all()


@pytest.mark.parametrize(
    ("options", "found"),
    [
        ({"width": 0}, "an image of 0 x 120"),
        ({"width": 100_000, "height": 100_000}, "expected 1 to"),
        ({"view_deg": 180.0}, "view_deg is 180"),
        ({"yaw_deg": math.nan}, "yaw_deg is nan"),
        ({"above_floor_mm": 0.0}, "above_floor_mm is 0"),
    ],
)
def test_cameras_that_make_no_sense(options: dict[str, float], found: str) -> None:
    with pytest.raises(ValueError, match=found):
        CameraConfig(**options)  # type: ignore[arg-type]


def test_the_lens_is_below_the_ceiling() -> None:
    with pytest.raises(ValueError, match="expected less than the ceiling's 2700"):
        Camera(scene(ROOM), CameraConfig(above_floor_mm=2700.0), robot_radius_mm=400.0)
