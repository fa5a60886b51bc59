from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from colony.vision.gray_images import gray_image


@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 1), (5, 7, 3)])
def test_any_number_of_channels_becomes_one(shape: tuple[int, ...]) -> None:
    gray = gray_image(np.full(shape, 90, dtype=np.uint8))
    assert gray.shape == (5, 7)
    assert gray.dtype == np.uint8
    assert (gray == 90).all()


def test_green_is_the_brightest_of_the_colors() -> None:
    colors = np.zeros((4, 4, 3), dtype=np.uint8)
    colors[0, 0], colors[1, 1], colors[2, 2] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    gray = gray_image(colors)
    assert [int(gray[i, i]) for i in range(4)] == [76, 149, 28, 0]


@pytest.mark.parametrize(
    ("image", "found"),
    [
        (np.zeros((9, 9)), "dtype float64"),
        (np.zeros((9, 9), dtype=np.uint16), "dtype uint16"),
        (np.zeros(81, dtype=np.uint8), r"shape \(81,\)"),
        (np.zeros((9, 9, 2), dtype=np.uint8), r"shape \(9, 9, 2\)"),
        (np.zeros((9, 9, 3, 1), dtype=np.uint8), r"shape \(9, 9, 3, 1\)"),
        (np.zeros((0, 9), dtype=np.uint8), r"shape \(0, 9\)"),
        (np.zeros((9, 3), dtype=np.uint8), r"shape \(9, 3\)"),
        ([[0, 0], [0, 0]], "list"),
        (None, "NoneType"),
    ],
)
def test_what_is_no_image_is_refused(image: Any, found: str) -> None:
    with pytest.raises(ValueError, match=f"an image of {found}; expected"):
        gray_image(image)
