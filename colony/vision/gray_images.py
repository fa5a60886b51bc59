"""Gray images, the input of the detectors."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from colony.vision.level_camera import AHEAD, LevelCamera

Gray = NDArray[np.uint8]
"""An image: (rows, columns), from 0 (black) to 255 (white)."""

MIN_PIXELS = 4
"""Minimum number of rows and of columns that a detector accepts."""

_WEIGHTS = np.array([77, 150, 29], dtype=np.uint16)  # in 256ths: red, green, blue


def gray_image(image: NDArray[Any]) -> Gray:
    """Convert an image to gray: (rows, columns), or with a last axis of 1 or 3 (RGB).

    Raises:
        ValueError: `image` is not a uint8 array of such a shape, or is too small.
    """
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8:
        found = f"dtype {image.dtype}" if isinstance(image, np.ndarray) else type(image).__name__
        raise ValueError(f"an image of {found}; expected an array of uint8, from 0 to 255")
    channels = image.shape[2] if image.ndim == 3 else 1
    if image.ndim not in (2, 3) or channels not in (1, 3) or min(image.shape[:2]) < MIN_PIXELS:
        min_size = f"{MIN_PIXELS} x {MIN_PIXELS}"
        raise ValueError(
            f"an image of shape {image.shape}; expected (rows, columns), (rows, columns, 1) or "
            f"(rows, columns, 3) with at least {min_size} pixels"
        )
    if image.ndim == 2:
        return image
    if channels == 1:
        return np.ascontiguousarray(image[:, :, 0])
    gray: Gray = ((image.astype(np.uint16) * _WEIGHTS).sum(axis=2, dtype=np.uint16) >> 8).astype(np.uint8)
    return gray


def gray_band(image: NDArray[Any], camera: LevelCamera | None, first_row: int) -> tuple[Gray, LevelCamera]:
    """Return an image in gray, with its camera.

    The image is complete, or a band that begins with row `first_row`. The default camera is RoME's, with
    images of this size.

    Raises:
        ValueError: `image` is not an image, or not one of this camera.
    """
    gray = gray_image(image)
    camera = camera or replace(AHEAD, columns=gray.shape[1], rows=gray.shape[0])
    if gray.shape[1] != camera.columns or first_row < 0 or first_row + gray.shape[0] > camera.rows:
        raise ValueError(
            f"an image of {gray.shape[0]} rows from row {first_row} on, {gray.shape[1]} columns; expected "
            f"rows of a camera's {camera.rows}, of {camera.columns} columns"
        )
    return gray, camera
