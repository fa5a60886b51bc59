from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from colony.sim.cameras.ceiling import LIGHT_ALONG_MM, lens_of
from colony.vision.lights.ceiling_camera import LIGHT_LENGTH_MM, UPWARD
from tests.sim.robots import UP_CAMERA


def test_the_image_covers_what_the_thesis_says() -> None:
    length = UPWARD.ahead_of(UPWARD.columns - 0.5) - UPWARD.ahead_of(-0.5)
    width = UPWARD.left_of(-0.5) - UPWARD.left_of(UPWARD.rows - 0.5)
    assert length == pytest.approx(2 * 1350 * math.tan(math.radians(30)))
    assert (round(length, -2), round(width, -2)) == (1600, 1200)


def test_columns_grow_ahead_and_rows_to_the_right() -> None:
    assert UPWARD.ahead_of(119.5) == UPWARD.left_of(59.5) == 0.0
    assert UPWARD.ahead_of(120) > 0 > UPWARD.ahead_of(119)
    assert UPWARD.left_of(59) > 0 > UPWARD.left_of(60)


def test_offsets_and_pixels_are_inverse_to_each_other() -> None:
    camera = replace(
        UPWARD, columns=320, rows=200, length_deg=70.0, height_mm=900.0, ahead_mm=120.0, left_mm=-80.0
    )
    for pixel in np.linspace(-10, 330, 35):
        assert camera.column_of(camera.ahead_of(pixel)) == pytest.approx(pixel)
        assert camera.row_of(camera.left_of(pixel)) == pytest.approx(pixel)


def test_scan_lines_are_at_the_quarters() -> None:
    assert UPWARD.scan_rows == (30, 60, 90)


def test_the_simulator_renders_with_the_same_geometry() -> None:
    lens = lens_of(UP_CAMERA)
    assert (lens.along_mm, lens.across_mm) == pytest.approx((UPWARD.mm_per_column, UPWARD.mm_per_row))
    assert lens.center_column == pytest.approx(UPWARD.column_of(0.0))
    assert lens.center_row == pytest.approx(UPWARD.row_of(0.0))
    assert LIGHT_ALONG_MM == LIGHT_LENGTH_MM


@pytest.mark.parametrize(
    "wrong",
    [
        {"columns": 1},
        {"length_deg": 180.0},
        {"across_deg": 0.0},
        {"height_mm": math.inf},
        {"left_mm": math.nan},
    ],
)
def test_what_is_no_camera_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected"):
        replace(UPWARD, **wrong)  # type: ignore[arg-type]
