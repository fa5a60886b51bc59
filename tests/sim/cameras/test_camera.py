"""What a simulated camera sees, held against projections computed by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from colony.nav.maps.walls import walls_of
from colony.sim.cameras.camera import Camera
from colony.sim.cameras.optics import PINHOLE, Optics
from colony.sim.cameras.scene import scene_of
from colony.sim.cameras.surfaces import CEILING_MM, PERSON_WIDTH_MM, RenderedScene, WallPanel, scene
from colony.sim.hazards.hazards import Hazard, Hazards, draw
from colony.sim.world.world import Speed, World
from tests.buildings import HALLWAY
from tests.sim.robots import FRONT_CAMERA, IDEAL

ROOM = [
    [-3000.0, -3000.0, -3000.0, 3000.0],
    [-3000.0, 3000.0, 3000.0, 3000.0],
    [3000.0, 3000.0, 3000.0, -3000.0],
    [3000.0, -3000.0, -3000.0, -3000.0],
]
EYE = 1350.0
FOCAL = 120.0 / math.tan(math.radians(30.0))


def see(
    made: RenderedScene, *poses: tuple[float, float, float], robot: int = 0, **options: float
) -> NDArray[np.uint8]:
    camera = Camera(made, replace(FRONT_CAMERA, optics=PINHOLE, **options), robot_radius_mm=400.0)  # type: ignore[arg-type]
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
    made = scene(ROOM, [WallPanel(1, 2000.0, 3000.0, 0.0, 2000.0, 0.1)])
    image = see(made, (0.0, -2000.0, 0.0))
    dark = image[60] < 60
    assert dark.sum() == round(1000.0 / 5000.0 * FOCAL)
    assert np.flatnonzero(dark)[-1] == 119  # it ends straight ahead, and is on the left of that
    assert row_of(2000.0, 5000.0) in edges(image[:, 110])


def test_the_left_wall_is_on_the_left_and_yaw_counts_counterclockwise() -> None:
    made = scene(ROOM, [WallPanel(0, 0.0, 6000.0, 0.0, CEILING_MM, 0.0)])  # the west wall is black
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
        replace(FRONT_CAMERA, **options)  # type: ignore[arg-type]


def test_the_lens_is_below_the_ceiling() -> None:
    with pytest.raises(ValueError, match="expected less than the ceiling's 2700"):
        Camera(scene(ROOM), replace(FRONT_CAMERA, above_floor_mm=2700.0), robot_radius_mm=400.0)


# --- what a lens and a sensor do, and who is in the way --------------------------------------------


REAL = Camera(scene_of(HALLWAY), replace(FRONT_CAMERA, yaw_deg=90.0), robot_radius_mm=400.0, seed=5)
HERE = np.array([list(HALLWAY.start)])


def test_the_same_seed_time_and_place_give_the_same_image() -> None:
    again = Camera(scene_of(HALLWAY), replace(FRONT_CAMERA, yaw_deg=90.0), robot_radius_mm=400.0, seed=5)
    other = Camera(scene_of(HALLWAY), replace(FRONT_CAMERA, yaw_deg=90.0), robot_radius_mm=400.0, seed=6)
    image = REAL.image(HERE, 0, 7)
    assert (again.image(HERE, 0, 7) == image).all()
    assert (REAL.image(HERE, 0, 8) != image).mean() > 0.5
    assert (other.image(HERE, 0, 7) != image).mean() > 0.5


def test_noise_has_its_standard_deviation() -> None:
    images = np.array([REAL.image(HERE, 0, t_ns) for t_ns in range(40)], dtype=float)
    assert images.std(axis=0).mean() == pytest.approx(2.5, abs=0.1)


@pytest.mark.parametrize(("first", "count"), [(0, 120), (0, 1), (119, 1), (40, 41)])
def test_some_rows_are_as_in_the_whole_image(first: int, count: int) -> None:
    walls = walls_of(HALLWAY).segments
    world = World(walls=walls, poses=[HALLWAY.start], config=IDEAL)
    draw = REAL.shot(world, 0, 9)
    whole = REAL.see(world, 0, 9)
    assert (draw(first, count) == whole[first : first + count]).all()


@pytest.mark.parametrize(("first", "count"), [(-1, 3), (0, 0), (118, 3)])
def test_rows_that_there_are_not(first: int, count: int) -> None:
    world = World(walls=walls_of(HALLWAY).segments, poses=[HALLWAY.start], config=IDEAL)
    with pytest.raises(ValueError, match="expected at least 1 of rows 0 to 119"):
        REAL.shot(world, 0, 9)(first, count)


def test_corners_are_darker_and_places_have_gains_of_their_own() -> None:
    made, optics = scene(ROOM), Optics(noise=0.0, gain=0.0)
    plain, shaded, uneven = (
        Camera(made, replace(FRONT_CAMERA, view_deg=20.0, height=60, optics=one), robot_radius_mm=400.0)
        for one in (replace(optics, vignetting=0.0), optics, replace(optics, vignetting=0.0, gain=0.2))
    )
    at = np.array([[0.0, 0.0, 0.0]])
    ratio = shaded.image(at, 0) / plain.image(at, 0)
    assert ratio[30, 120] == pytest.approx(1.0, abs=0.02)
    assert ratio[0, 0] == pytest.approx(1.0 - 0.22, abs=0.02)
    gains = []
    for x in range(-2800, 2800, 700):
        for y in range(-2800, 2000, 700):
            there = np.array([[float(x), float(y), 0.0]])
            gains.append((uneven.image(there, 0) / plain.image(there, 0)).mean())
    assert 0.78 <= min(gains) < 0.97 or 1.03 < max(gains) <= 1.22
    assert min(gains) >= 0.78
    assert max(gains) <= 1.22


def width_of_edge(image: NDArray[np.uint8]) -> float:
    """Over how many columns the black part of a wall becomes the bright one: from 10 to 90 %."""
    row = image[20:100].astype(float).mean(axis=0)
    part = (row - row[:20].mean()) / (row[-20:].mean() - row[:20].mean())
    return float(np.interp(0.9, part, np.arange(240)) - np.interp(0.1, part, np.arange(240)))


def test_what_moves_past_is_smeared_by_how_far_it_moves_during_the_exposure() -> None:
    made = scene(ROOM, [WallPanel(0, 0.0, 3000.0, 0.0, CEILING_MM, 0.0)])  # the south half of the west wall
    camera = Camera(
        made, replace(FRONT_CAMERA, yaw_deg=90.0, optics=Optics(noise=0.0)), robot_radius_mm=400.0
    )
    at = np.array([[-2000.0, 0.0, 0.0]])  # a meter from the edge
    still, turning = camera.image(at, 0), camera.image(at, 0, speed=Speed(0.0, 60.0))
    driving = camera.image(at, 0, speed=Speed(1500.0, 0.0))
    assert width_of_edge(still) < 2.5
    smear = 1500.0 * 0.016 / 1000.0 * FOCAL
    assert width_of_edge(driving) == pytest.approx(0.8 * smear, abs=1.5)
    assert width_of_edge(turning) == pytest.approx(0.8 * math.radians(60.0 * 0.016) * FOCAL, abs=1.5)


def test_edges_move_by_less_than_a_pixel() -> None:
    made = scene(ROOM, [WallPanel(0, 0.0, 3000.0, 0.0, CEILING_MM, 0.0)])
    camera = Camera(
        made, replace(FRONT_CAMERA, yaw_deg=90.0, optics=Optics(noise=0.0)), robot_radius_mm=400.0
    )

    def edge(y: float) -> float:
        row = camera.image(np.array([[-2000.0, y, 0.0]]), 0)[20:100].astype(float).mean(axis=0)
        part = (row - row[:20].mean()) / (row[-20:].mean() - row[:20].mean())
        return float(np.interp(0.5, part, np.arange(240)))

    found = np.array([edge(y) for y in np.arange(0.0, 20.0, 1.0)])
    expected = 119.5 - np.arange(0.0, 20.0, 1.0) / 1000.0 * FOCAL
    assert np.abs(found - expected).max() < 0.25


def test_people_hide_what_is_behind_them_and_walls_hide_people() -> None:
    made = scene([*ROOM, [-3000.0, 2000.0, 3000.0, 2000.0]])
    camera = Camera(made, replace(FRONT_CAMERA, optics=PINHOLE), robot_radius_mm=400.0)
    at = np.array([[0.0, -2500.0, 0.0]])
    alone = camera.image(at, 0)
    image = camera.image(at, 0, people=np.array([[500.0, 500.0]]))
    columns = np.flatnonzero((image != alone).any(axis=0))
    middle = 119.5 + 500.0 / 3000.0 * FOCAL
    half = PERSON_WIDTH_MM / 2.0 / 3000.0 * FOCAL
    assert columns[0] == pytest.approx(middle - half, abs=3.0)
    assert columns[-1] == pytest.approx(middle + half, abs=3.0)
    rows = np.flatnonzero((image != alone).any(axis=1))
    assert row_of(1900.0, 3000.0) <= rows[0] <= row_of(1600.0, 3000.0)
    assert rows[-1] == 119  # shoes are below the image
    behind = camera.image(at, 0, people=np.array([[500.0, 2500.0]]))
    assert (behind == alone).all()
    near, far = [300.0, -500.0], [500.0, 500.0]
    only, both = (camera.image(at, 0, people=np.array(people)) for people in ([near], [near, far]))
    hidden = only != alone
    assert (both[hidden] == only[hidden]).mean() > 0.97  # where the nearer one is no edge
    assert (both != only).any()


def test_a_person_hides_a_robot_and_a_robot_a_person() -> None:
    camera = Camera(scene(ROOM), replace(FRONT_CAMERA, optics=PINHOLE), robot_radius_mm=400.0)
    poses = np.array([[0.0, -2500.0, 0.0], [0.0, 0.0, 0.0]])
    robot = camera.image(poses, 0)
    behind = camera.image(poses, 0, people=np.array([[0.0, 1000.0]]))
    before = camera.image(poses, 0, people=np.array([[0.0, -1000.0]]))
    hull = slice(row_of(1000.0, 2100.0) + 2, row_of(0.0, 2100.0) - 2)
    assert (behind[hull, 119] == robot[hull, 119]).all()
    assert (before[hull, 119] != robot[hull, 119]).mean() > 0.8


def test_a_world_is_seen_with_its_people() -> None:
    scenery = draw(Hazards(person_spacing_mm=4000.0).only(Hazard.PEOPLE), HALLWAY, 3)
    track = scenery.people[0].track
    x, y = track.point_at(track.length_mm / 2)
    world = World(walls=scenery, poses=[(x, y, track.heading_deg)], config=IDEAL)
    camera = Camera(scene_of(HALLWAY, scenery), replace(FRONT_CAMERA, optics=PINHOLE), robot_radius_mm=400.0)
    assert (camera.see(world, 0, 0) == camera.image(world.true_poses, 0, people=world.people)).all()
    px, py = world.people[0]
    toward = math.degrees(math.atan2(-(px - x), py - y))
    world.place(0, (x, y, toward))
    assert (camera.see(world, 0, 0) != camera.image(world.true_poses, 0)).mean() > 0.002


@pytest.mark.parametrize(
    ("wrong", "found"),
    [({"rays": 0}, "rays is 0"), ({"blur": math.nan}, "blur is nan"), ({"noise": -1.0}, "expected 0 to 255")],
)
def test_optics_that_make_no_sense(wrong: dict[str, float], found: str) -> None:
    with pytest.raises(ValueError, match=found):
        Optics(**wrong)  # type: ignore[arg-type]
