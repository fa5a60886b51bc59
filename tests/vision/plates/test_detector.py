from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from colony.vision.detections import PlateBox
from colony.vision.gray_images import Gray
from colony.vision.level_camera import AHEAD, SIDE, LevelCamera
from colony.vision.plates.detector import find_plates
from studies.thesis.wall_view import WallView
from tests.vision.plates.walls import Board, corners_of, plate, wall_image


def is_at(
    found: PlateBox, board: Board, view: WallView, camera: LevelCamera = SIDE, off: float = 1.2
) -> bool:
    wanted = corners_of(board, view, camera)
    off = max(off, 0.02 * float(np.ptp(wanted[:, 0])))  # of a large plate it is no more, relative to it
    return bool(np.abs(np.array(found.corners) - wanted).max() <= off)


VIEWS = [
    WallView(distance, tilt) for distance in (650.0, 1000.0, 1500.0, 1850.0, 2200.0) for tilt in (-8.0, 5.0)
]


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: f"{view.distance_mm:.0f}mm {view.tilt_deg:+.0f}deg")
@pytest.mark.parametrize("text", ["364", "A342", "7", "WOMEN"])
def test_a_plate_is_found_where_it_is(view: WallView, text: str) -> None:
    board = plate(text, -view.distance_mm * np.tan(np.radians(-view.tilt_deg)) * 0.7)
    (found,) = find_plates(wall_image([board], view, seed=1), tilt_deg=view.tilt_deg)
    assert found.score >= 0.5
    assert is_at(found, board, view)


@pytest.mark.parametrize("gain", [0.25, 0.5, 1.0, 1.6])
@pytest.mark.parametrize("wall", [100, 150, 210])
def test_light_and_dark_walls_and_corridors(gain: float, wall: int) -> None:
    view = WallView(1500.0, 3.0)
    board = plate("352", 200.0)
    (found,) = find_plates(wall_image([board], view, wall=wall, gain=gain))
    assert is_at(found, board, view)


@pytest.mark.parametrize("smear", [1, 3, 5])
def test_blur_of_lens_and_motion(smear: int) -> None:
    view, board = WallView(1500.0, 0.0), plate("352")
    image = cv2.blur(wall_image([board], view, blur=1.2), (smear, 1))
    (found,) = find_plates(image)
    assert is_at(found, board, view, off=2.0)


@pytest.mark.parametrize(("columns", "rows"), [(320, 240), (480, 240), (640, 480), (200, 100)])
def test_other_sizes_of_images(columns: int, rows: int) -> None:
    camera = replace(AHEAD, columns=columns, rows=rows)
    view, board = WallView(1400.0, 4.0), plate("A391", -100.0)
    image = wall_image([board], view, camera, blur=0.7 * columns / 240)
    (found,) = find_plates(image)
    assert is_at(found, board, view, camera, off=1.2 * max(columns / 240, 1.0))


def test_color_is_no_matter() -> None:
    image = wall_image([plate("352")], WallView(1500.0, 0.0))
    assert find_plates(np.stack([image] * 3, axis=2))[0].center == pytest.approx(
        find_plates(image)[0].center, abs=0.2
    )


def test_two_plates() -> None:
    view = WallView(1800.0, 0.0)
    boards = [plate("352", 500.0), plate("354", -500.0)]
    found = sorted(find_plates(wall_image(boards, view)), key=lambda box: box.center[0])
    assert [is_at(box, board, view) for box, board in zip(found, boards, strict=True)] == [True, True]


def test_a_band_is_the_same_as_its_image() -> None:
    image = wall_image([plate("352")], WallView(1500.0, 0.0))
    (whole,), (part,) = find_plates(image), find_plates(image[30:90], SIDE, first_row=30)
    lowered = np.array(part.corners) + np.array([0.0, 30.0])
    assert np.abs(lowered - whole.corners).max() < 0.1
    assert find_plates(image[:20], SIDE) == ()


NO_PLATES = {
    "nothing is written": Board(place_mm=0.0),
    "two lines": Board(place_mm=0.0, text=("NO FOOD", "IN HERE"), character_mm=36.0),
    "small characters": Board(place_mm=0.0, text=("SEMINAR",), character_mm=40.0),
    "too high": replace(plate("352"), above_floor_mm=1480.0),
    "black on white": replace(plate("352"), shade=230, ink=18),
    "square": Board(place_mm=0.0, width_mm=200.0, height_mm=200.0, text=("35",)),
    "long": Board(place_mm=0.0, width_mm=700.0, height_mm=127.0, text=("ROBOTICS",), character_mm=70.0),
    "a line on a large board": Board(place_mm=0.0, width_mm=800.0, height_mm=500.0, text=("352",)),
    "a dark door": Board(place_mm=0.0, width_mm=900.0, height_mm=1600.0, above_floor_mm=1350.0),
}


@pytest.mark.parametrize("name", list(NO_PLATES))
@pytest.mark.parametrize("distance", [900.0, 1500.0, 1900.0])
def test_what_is_no_plate(name: str, distance: float) -> None:
    assert find_plates(wall_image([NO_PLATES[name]], WallView(distance, 2.0)), tilt_deg=2.0) == ()


@pytest.mark.parametrize("seed", range(4))
def test_a_bare_wall_has_none(seed: int) -> None:
    assert find_plates(wall_image([], WallView(1500.0, 0.0), noise=6.0, seed=seed)) == ()


def test_a_plate_before_dark_bricks() -> None:
    """The plate is no dark patch of its own: only its characters stand out, and some of its edges."""
    view, board = WallView(1550.0, 0.0), plate("A369")
    bricks = [
        Board(place_mm=-80.0, width_mm=190.0, height_mm=190.0, above_floor_mm=1350.0 + 63.0 + 95.0, shade=20),
        Board(place_mm=170.0, width_mm=190.0, height_mm=190.0, above_floor_mm=1350.0 - 40.0, shade=20),
    ]
    (found,) = find_plates(wall_image([*bricks, board], view), tilt_deg=0.0)
    assert is_at(found, board, view, off=2.0)


def test_a_plate_that_is_half_beyond_the_image_is_not_told() -> None:
    assert find_plates(wall_image([plate("352", 860.0)], WallView(1500.0, 0.0))) == ()


@given(
    arrays.arrays(
        np.uint8,
        st.tuples(st.integers(4, 60), st.integers(4, 90)),
        elements=st.sampled_from([0, 40, 200, 255]),
    )
)
@settings(max_examples=60, deadline=None)
def test_no_image_is_too_odd(image: Gray) -> None:
    for plate_box in find_plates(image):
        assert np.isfinite(plate_box.corners).all()


@pytest.mark.parametrize("seed", range(6))
def test_noise_shows_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert find_plates(rng.integers(0, 256, (120, 240), dtype=np.uint8)) == ()


def test_what_is_no_image_of_the_camera_is_refused() -> None:
    with pytest.raises(ValueError, match="shape"):
        find_plates(np.zeros((120, 240, 4), dtype=np.uint8))
    with pytest.raises(
        ValueError, match="60 rows from row 70 on, 240 columns; expected rows of a camera's 120"
    ):
        find_plates(np.zeros((60, 240), dtype=np.uint8), SIDE, first_row=70)
    with pytest.raises(ValueError, match="expected rows of a camera's 120, of 240 columns"):
        find_plates(np.zeros((120, 320), dtype=np.uint8), SIDE)
