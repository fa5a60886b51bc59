from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from colony.vision.level_camera import AHEAD, SIDE
from studies.thesis.plate_boxes import MIDDLE_LEVEL, scan_band, stretch, thesis_plates
from studies.thesis.wall_view import WallView
from tests.vision.plates.walls import Board, corners_of, plate, wall_image

FACED = WallView(1500.0, 0.0)


def test_the_stretch_of_gray_levels() -> None:
    assert (stretch(0.0), stretch(MIDDLE_LEVEL), stretch(255.0)) == (0.0, MIDDLE_LEVEL, 255.0)
    # What is dark in the negative grows darker, what is bright brighter: (x / M)^5 M below M = 204.
    assert stretch(102.0) == pytest.approx(204.0 / 32.0)
    assert stretch(204.0 + 51.0 / 4.0) == pytest.approx(204.0 + 51.0 / 2.0)
    levels = [stretch(level) for level in range(256)]
    assert levels == sorted(levels)


def test_a_plate_is_found_where_it_is() -> None:
    board = plate("364", 120.0)
    (found,) = thesis_plates(wall_image([board], FACED))
    assert np.abs(np.array(found.corners) - corners_of(board, FACED)).max() < 1.6


def test_both_plates_of_an_image_are_found_from_left_to_right() -> None:
    first, second = plate("364", 400.0), plate("366", -400.0)
    found = thesis_plates(wall_image([first, second], FACED))
    assert [round(box.center[0], -1) for box in found] == [60.0, 180.0]


def test_what_was_seen_before_is_left_out() -> None:
    image = wall_image([plate("364", 400.0), plate("366", -400.0)], FACED)
    assert [round(box.center[0], -1) for box in thesis_plates(image, starting_column=90)] == [180.0]
    assert thesis_plates(image, starting_column=240) == ()


def test_a_plate_above_the_middle_line_is_found_too() -> None:
    board = replace(plate("364"), above_floor_mm=1415.0)
    assert len(thesis_plates(wall_image([board], FACED))) == 1


def test_what_goes_on_beyond_the_scan_lines_is_none() -> None:
    assert thesis_plates(wall_image([plate("364")], WallView(600.0, 0.0))) == ()


@pytest.mark.parametrize("board", [Board(place_mm=0.0, width_mm=110.0), Board(place_mm=0.0, height_mm=40.0)])
def test_what_has_another_size_is_none(board: Board) -> None:
    assert thesis_plates(wall_image([board], FACED)) == ()


def test_a_black_poster_of_this_size_is_taken_for_a_plate() -> None:
    poster = Board(place_mm=0.0, width_mm=360.0, height_mm=130.0, text=("no", "food"), character_mm=35.0)
    assert len(thesis_plates(wall_image([poster], FACED))) == 1


def test_a_band_is_the_same_as_its_image() -> None:
    image = wall_image([plate("364")], FACED)
    (whole,) = thesis_plates(image)
    first, count = scan_band(SIDE)
    assert (first, count) == (40, 40)
    (part,) = thesis_plates(image[first : first + count], SIDE, first_row=first)
    assert [(column, row + first) for column, row in part.corners] == list(whole.corners)
    assert thesis_plates(image[:20], SIDE, first_row=0) == ()


@pytest.mark.parametrize("level", [0, 128, 255])
def test_an_image_of_one_shade_shows_nothing(level: int) -> None:
    assert thesis_plates(np.full((120, 240), level, dtype=np.uint8)) == ()


def test_what_is_no_image_of_the_camera_is_refused() -> None:
    with pytest.raises(ValueError, match="dtype float64"):
        thesis_plates(np.zeros((120, 240)))
    with pytest.raises(ValueError, match="40 rows from row 90 on, 240 columns; expected rows of a camera's"):
        thesis_plates(np.zeros((40, 240), dtype=np.uint8), SIDE, first_row=90)
    with pytest.raises(ValueError, match="120 rows from row 0 on, 240 columns; expected"):
        thesis_plates(np.zeros((120, 240), dtype=np.uint8), replace(AHEAD, columns=320))
