from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from studies.thesis.chain_code import MIN_CORNERNESS, Border, cornerness, corners, trace_border

_STEPS = ((1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1))


def border_of(binary: np.ndarray) -> Border:
    """The outer border of what is found first in the centerline."""
    row = binary.shape[0] // 2
    column = int(np.flatnonzero(binary[row])[0])
    border = trace_border(binary, column, row)
    assert border is not None
    return border


def box(left: int = 10, top: int = 8, right: int = 45, bottom: int = 24) -> np.ndarray:
    binary = np.zeros((32, 60), dtype=np.bool_)
    binary[top:bottom, left:right] = True
    return binary


def test_a_rectangle_is_followed_clockwise() -> None:
    border = border_of(box())
    assert len(border.pixels) == 2 * (35 + 16) - 4
    assert border.pixels[0].tolist() == [10, 16]
    changes = [int(code) for i, code in enumerate(border.codes) if code != border.codes[i - 1]]
    assert changes == [0, 6, 4, 2]
    assert border.codes[0] == 2  # up, along the left edge


def test_each_step_leads_to_the_next_pixel_and_the_last_one_back() -> None:
    border = border_of(box())
    steps = np.array([_STEPS[code] for code in border.codes])
    assert (border.pixels + steps == np.roll(border.pixels, -1, axis=0)).all()


@given(st.integers(0, 2**32 - 1), st.integers(3, 9))
@settings(max_examples=60, deadline=None)
def test_any_region_has_the_border_that_opencv_finds(seed: int, size: int) -> None:
    noise = np.random.default_rng(seed).random((24, 40)).astype(np.float32)
    binary = cv2.GaussianBlur(noise, (0, 0), size / 6.0) > 0.5
    binary[[0, -1]] = False
    binary[:, [0, -1]] = False
    rising = np.argwhere(~binary[:, :-1] & binary[:, 1:])
    outer, _ = cv2.findContours(binary.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    wanted = {frozenset(map(tuple, contour[:, 0].tolist())) for contour in outer if len(contour) > 1}
    found = set()
    for row, column in rising.tolist():
        # The uppermost, leftmost pixel of a region is on its outer border.
        region = next((c for c in wanted if min((y, x) for x, y in c) == (row, column + 1)), None)
        if region is not None:
            border = trace_border(binary, column + 1, row)
            if border is not None:
                found.add(frozenset(map(tuple, border.pixels.tolist())))
    on_the_rim = {c for c in wanted if any(x in (0, 39) or y in (0, 23) for x, y in c)}
    assert found == wanted - on_the_rim


def test_what_meets_the_rim_of_the_image_is_not_closed() -> None:
    assert trace_border(box(left=0), 0, 16) is None
    assert trace_border(box(top=0), 10, 16) is None
    assert trace_border(box(right=60), 10, 16) is None
    assert trace_border(box(bottom=32), 10, 16) is None


def test_a_single_pixel_has_no_border() -> None:
    assert trace_border(box(20, 16, 21, 17), 20, 16) is None


@pytest.mark.parametrize(("width", "height"), [(20, 9), (40, 14), (100, 36)])
def test_a_rectangle_has_four_corners(width: int, height: int) -> None:
    binary = np.zeros((60, 140), dtype=np.bool_)
    binary[30 - height // 2 : 30 - height // 2 + height, 20 : 20 + width] = True
    found = {tuple(corner) for corner in corners(border_of(binary)).tolist()}
    top, left = 30 - height // 2, 20
    right, bottom = left + width - 1, top + height - 1
    assert found == {(left, top), (right, top), (right, bottom), (left, bottom)}


def test_corners_of_a_noisy_trapezoid_are_near_its_own() -> None:
    image = np.zeros((60, 140), dtype=np.uint8)
    wanted = np.array([(20, 20), (100, 14), (100, 46), (20, 40)])
    cv2.fillConvexPoly(image, wanted, 255)
    found = corners(border_of(image > 0))
    for corner in wanted:
        assert np.hypot(*(found - corner).T).min() <= 2.0


def test_a_circle_has_no_corners_as_sharp_as_a_rectangle() -> None:
    image = np.zeros((80, 80), dtype=np.uint8)
    cv2.circle(image, (40, 40), 30, 255, -1)
    round_ = cornerness(border_of(image > 0).codes)
    assert round_.max() < cornerness(border_of(box()).codes).max() / 2.0


def test_cornerness_grows_with_the_arms_up_to_a_limit() -> None:
    codes = border_of(box()).codes
    short = cornerness(codes, longest_arm=3).max()
    assert MIN_CORNERNESS / 2.0 < short < cornerness(codes, longest_arm=10).max()
    assert cornerness(codes, longest_arm=10).max() == pytest.approx(
        cornerness(border_of(box(right=55)).codes, longest_arm=10).max()
    )


def test_a_curve_shorter_than_a_segment_has_no_corner() -> None:
    assert len(corners(border_of(box(20, 16, 22, 18)))) == 0
