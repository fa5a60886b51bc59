"""Markers in pictures, drawn by the pinhole camera's equations and by the simulator."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from colony.nav.maps.signs import MARKER_CODES, MARKER_WIDTH_MM, Sign, markers_of, plates_of
from colony.nav.maps.stickrep.reader import load_map
from colony.sim.cameras.camera import Camera
from colony.sim.cameras.scene import scene_of
from colony.sim.cameras.snapshot import snapshot
from colony.sim.hazards.hazards import Hazards, draw
from colony.vision.detections import MarkerBox
from colony.vision.level_camera import AHEAD
from colony.vision.markers.rows import edge_units, find_markers
from tests.paths import MAPS
from tests.sim.robots import FRONT_CAMERA
from tests.vision.markers.views import View, picture

MAP = MAPS / "msu_engineering_3.stickrep"
every_code = pytest.mark.parametrize("code", MARKER_CODES)


def the_one(view: View, seed: int = 0) -> MarkerBox:
    found = find_markers(picture(view, seed=seed))
    assert len(found) == 1, (view, found)
    return found[0]


# --- what is drawn from equations ------------------------------------------------------------------------


@every_code
def test_a_marker_is_where_the_camera_sees_it(code: int) -> None:
    box = the_one(View(code=code, ahead_mm=1_200.0, right_mm=50.0))
    half = MARKER_WIDTH_MM / 2.0
    middle = (AHEAD.columns - 1) / 2.0
    assert box.code == code
    assert box.left == pytest.approx(middle + AHEAD.focal * (50.0 - half) / 1_200.0, abs=0.2)
    assert box.right == pytest.approx(middle + AHEAD.focal * (50.0 + half) / 1_200.0, abs=0.2)
    assert len(box.edges) == len(edge_units(code))
    assert (box.edges[0], box.edges[-1]) == (box.left, box.right)
    assert 44 <= box.first_row <= 47  # it has 26 rows around 59.5
    assert 72 <= box.last_row <= 75


def test_stripes_are_one_unit_wide_or_three() -> None:
    assert edge_units(0b000) == (0, 1, 2, 3, 4, 5, 6, 7)
    assert edge_units(0b100) == (0, 3, 4, 5, 6, 7)
    assert edge_units(0b010) == (0, 1, 2, 5, 6, 7)
    assert edge_units(0b101) == (0, 3, 4, 7)


@every_code
@pytest.mark.parametrize("facing_deg", [-40.0, -20.0, 20.0, 40.0])
def test_it_is_seen_aslant(code: int, facing_deg: float) -> None:
    box = the_one(View(code=code, facing_deg=facing_deg))
    assert box.code == code
    wide, narrow = box.edges[1] - box.edges[0], box.edges[-1] - box.edges[-2]
    if code in (0b000, 0b010, 0b101):  # which are the same from both sides
        assert (wide > narrow) == (facing_deg > 0.0)


@every_code
@pytest.mark.parametrize("ahead_mm", [800.0, 2_000.0, 3_500.0, 4_800.0])
def test_it_is_seen_from_near_and_far(code: int, ahead_mm: float) -> None:
    assert the_one(View(code=code, ahead_mm=ahead_mm, noise=1.0)).code == code


@pytest.mark.parametrize(
    ("black", "white", "door"), [(8.0, 60.0, 35.0), (90.0, 255.0, 250.0), (30.0, 120.0, 70.0)]
)
def test_it_is_seen_in_any_exposure(black: float, white: float, door: float) -> None:
    for code in MARKER_CODES:
        assert the_one(View(code=code, black=black, white=white, door=door, noise=1.5)).code == code


def test_a_marker_is_found_whatever_the_conditions() -> None:
    chance = random.Random(8)
    found = 0
    for number in range(60):
        light = chance.uniform(0.3, 1.1)
        view = View(
            code=MARKER_CODES[number % 5],
            ahead_mm=chance.uniform(850.0, 3_000.0),
            facing_deg=chance.uniform(-40.0, 40.0),
            black=25.0 * light,
            white=225.0 * light,
            door=chance.uniform(80.0, 230.0) * light,
            blur_px=chance.uniform(0.4, 1.3),
            noise=chance.uniform(0.0, 4.0),
            raised_mm=chance.uniform(-60.0, 60.0),
        )
        boxes = find_markers(picture(view, seed=number))
        assert [box.code for box in boxes] in ([], [view.code]), (number, view)
        found += len(boxes)
    assert found >= 59


# --- what is no marker -----------------------------------------------------------------------------------


@every_code
@pytest.mark.parametrize("hidden", [0.25, 0.5, 0.75])
def test_half_a_marker_is_none(code: int, hidden: float) -> None:
    assert find_markers(picture(View(code=code, hidden=hidden))) == ()


@every_code
@pytest.mark.parametrize("cabin", [20.0, 60.0, 200.0])
@pytest.mark.parametrize("gap_mm", [120.0, 300.0, 600.0])
def test_doors_that_slide_apart_have_none(code: int, cabin: float, gap_mm: float) -> None:
    assert find_markers(picture(View(code=code, gap_mm=gap_mm, cabin=cabin))) == ()


@every_code
def test_stripes_from_ceiling_to_floor_are_none(code: int) -> None:
    line = picture(View(code=code, ahead_mm=2_500.0, noise=0.0))[60]
    assert find_markers(np.tile(line, (120, 1))) == ()


def test_other_widths_are_none() -> None:
    marker = picture(View(code=0b000, ahead_mm=1_500.0))
    middle = marker[:, 119:121]
    assert find_markers(np.hstack([marker[:, :119], *[middle] * 6, marker[:, 131:]])) == ()


def test_white_stripes_on_black_are_none() -> None:
    for code in MARKER_CODES:
        assert find_markers(255 - picture(View(code=code, door=225.0))) == ()


# --- rows and arrays -------------------------------------------------------------------------------------


def test_only_the_rows_asked_for_are_looked_at() -> None:
    image = picture(View(code=0b010))
    [box] = find_markers(image)
    assert find_markers(image, range(30)) == ()
    assert find_markers(image, range(box.first_row - 6, box.last_row + 7)) == (box,)
    [again] = find_markers(image[30:90], range(60))
    assert again._replace(first_row=again.first_row + 30, last_row=again.last_row + 30) == box


def test_a_marker_outside_of_the_middle_half_is_not_searched() -> None:
    raised = picture(View(code=0b010, ahead_mm=2_000.0, raised_mm=420.0))
    assert find_markers(raised) == ()
    [box] = find_markers(raised, range(60))
    assert box.last_row < 30


@pytest.mark.parametrize("rows", [range(121), range(-1, 60), range(0, 60, 2)])
def test_rows_that_the_image_does_not_have_are_refused(rows: range) -> None:
    with pytest.raises(ValueError, match=r"rows; expected neighboring rows"):
        find_markers(np.zeros((120, 240), dtype=np.uint8), rows)


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((120, 240)),
        np.zeros(240, dtype=np.uint8),
        np.zeros((0, 0), dtype=np.uint8),
        np.zeros((2, 120, 240, 1), dtype=np.uint8),
        [[0, 1], [2, 3]],
    ],
)
def test_what_is_no_image_is_refused(image: object) -> None:
    with pytest.raises(ValueError, match="expected"):
        find_markers(image)  # type: ignore[arg-type]


@pytest.mark.parametrize("shape", [(4, 4), (5, 240), (120, 8), (480, 640), (120, 240)])
def test_noise_of_any_size_has_no_marker(shape: tuple[int, int]) -> None:
    for seed in range(20):
        noise = np.random.default_rng(seed).integers(0, 256, shape).astype(np.uint8)
        assert find_markers(noise) == (), seed


def test_colors_are_seen_as_gray() -> None:
    image = picture(View(code=0b001))
    assert find_markers(np.repeat(image[:, :, None], 3, axis=2))[0].code == 0b001


# --- what the simulator draws ----------------------------------------------------------------------------


def before(sign: Sign, ahead_mm: float, aside_mm: float, turned_deg: float) -> tuple[float, float, float]:
    """A pose so far from a sign, to the left of its middle, turned to the left from facing it."""
    heading = np.radians(sign.heading_deg)
    x = sign.center.x + ahead_mm * np.sin(heading) - aside_mm * np.cos(heading)
    y = sign.center.y - ahead_mm * np.cos(heading) - aside_mm * np.sin(heading)
    return float(x), float(y), sign.heading_deg + turned_deg


def test_the_simulators_markers_are_found() -> None:
    floor = load_map(MAP)
    markers = markers_of(floor)
    assert len(markers) >= 2
    chance = random.Random(4)
    for number in range(30):
        marker = markers[number % len(markers)]
        ahead, aside, turned = (
            chance.uniform(850.0, 1_200.0),
            chance.uniform(-120.0, 120.0),
            chance.uniform(-5, 5),
        )
        image = snapshot(floor, before(marker, ahead, aside, turned), FRONT_CAMERA, seed=number)
        assert [box.code for box in find_markers(image)] == [marker.code], (number, ahead, aside, turned)


@pytest.mark.long
def test_there_is_no_marker_where_none_hangs() -> None:
    """500 pictures of corridors with people, posters, glass bricks, open doors and plates."""
    floor = load_map(MAP)
    markers, plates = markers_of(floor), plates_of(floor)
    chance = random.Random(5)
    false: list[tuple[float, float, float]] = []
    for seed in range(10):
        camera = Camera(scene_of(floor, draw(Hazards(), floor, seed=seed)), FRONT_CAMERA, robot_radius_mm=400)
        looked = 0
        while looked < 50:
            plate = chance.choice(plates)
            pose = before(
                plate, chance.uniform(600, 2_000), chance.uniform(-600, 600), chance.uniform(-180, 180)
            )
            if any(in_view(marker, pose) for marker in markers):
                continue
            looked += 1
            people = np.array([[pose[0] + chance.uniform(-3e3, 3e3), pose[1] + chance.uniform(-3e3, 3e3)]])
            if find_markers(camera.image(np.array([pose]), 0, looked, people=people)):
                false.append(pose)
    assert false == []


def in_view(sign: Sign, pose: tuple[float, float, float]) -> bool:
    """Whether a camera ahead may see a sign, were it not for walls."""
    x, y = sign.center.x - pose[0], sign.center.y - pose[1]
    bearing = math.remainder(math.degrees(math.atan2(-x, y)) - pose[2], 360.0)
    return math.hypot(x, y) < 12_000.0 and abs(bearing) < 45.0
