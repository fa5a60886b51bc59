from __future__ import annotations

import pytest

from colony.vision.level_camera import SIDE
from colony.vision.plates.outline import Patch, candidates, lines_of_text, merge_patches, outline_about
from studies.thesis.wall_view import WallView
from tests.vision.plates.walls import corners_of, plate, wall_image


def test_patches_of_most_thresholds_come_first() -> None:
    once, twice = Patch(0, 0, 10, 10), Patch(50, 0, 90, 20)
    assert merge_patches([once, twice, Patch(51, 0, 90, 20)]) == (Patch(51, 0, 90, 20), once)
    assert merge_patches([]) == ()


def test_patches_that_share_little_are_two() -> None:
    assert len(merge_patches([Patch(0, 0, 10, 10), Patch(5, 0, 15, 10)])) == 2
    assert len(merge_patches([Patch(0, 0, 10, 10), Patch(1, 0, 11, 10)])) == 1
    assert len(merge_patches([Patch(0, 0, 10, 10), Patch(20, 0, 30, 10)])) == 2


def test_a_patch_in_a_larger_image() -> None:
    assert Patch(1, 2, 3, 4).scaled(3) == Patch(3, 6, 9, 12)


@pytest.mark.parametrize("distance", [700.0, 1500.0, 2200.0])
def test_a_plate_is_a_dark_patch_and_a_line_of_text(distance: float) -> None:
    board, view = plate("352"), WallView(distance, 0.0)
    image = wall_image([board], view)
    left, top, right, bottom = corners_of(board, view)[[0, 2]].ravel().tolist()
    dark = candidates(image, 59.5)[0]
    assert dark == pytest.approx((left, top, right, bottom), abs=2.5)
    rough = outline_about(lines_of_text(image, 59.5)[0], 0.0, SIDE.focal, 119.5)
    assert (rough.left + rough.right) / 2.0 == pytest.approx((left + right) / 2.0, abs=1.5)
    assert rough.right - rough.left == pytest.approx(right - left, rel=0.15)


@pytest.mark.parametrize("place", [780.0, 850.0, 900.0, -780.0, -850.0, -900.0])
def test_what_goes_on_beyond_the_image_is_no_line(place: float) -> None:
    found = lines_of_text(wall_image([plate("35200", place)], WallView(1500.0, 0.0)), 59.5)
    assert all(0 < patch.left < patch.right < SIDE.columns for patch in found)
