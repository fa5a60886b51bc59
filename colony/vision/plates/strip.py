"""Cuts a door plate out of an image, as a small upright strip of fixed size and contrast for the reader.

The plate is warped from its four corners. If it is larger in the image than in the strip, areas are averaged.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from colony.vision.detections import Corner
from colony.vision.gray_images import Gray, gray_image

STRIP_ROWS, STRIP_COLUMNS = 24, 64

PLATE_LEFT, PLATE_RIGHT, PLATE_TOP, PLATE_BOTTOM = 2.5, 60.5, 1.5, 21.5
"""Edges of the plate in the strip, with a margin for inaccurate corners."""

MIN_CONTRAST = 6.0
"""Minimum standard deviation of the gray levels that is normalized to 1; stretching strips with less would
amplify noise."""

_MAX_SAMPLES = 4
_MIN_AREA = 12.0
_MAX_COORDINATE = 1e5

Floats = npt.NDArray[np.float32]
Corners = tuple[Corner, Corner, Corner, Corner]


def plate_strip(image: Gray, corners: Corners) -> Floats | None:
    """Cut out the strip of a plate.

    Args:
        image: uint8, (rows, columns), or with a last axis of one or three channels.
        corners: corners of the plate in the image, clockwise from the upper left; they may be outside of it,
            where the pixels at its border are repeated.

    Returns:
        (24, 64), with mean 0 and, with sufficient contrast, standard deviation 1; None if the corners are not
        finite, or not an upright convex quadrilateral of some pixels.

    Raises:
        ValueError: `image` is not such an image.
    """
    gray = gray_image(image)
    if not _is_plate(corners):
        return None
    import cv2

    samples = _samples(corners)
    plate_corners = np.array(
        [
            [PLATE_LEFT, PLATE_TOP], [PLATE_RIGHT, PLATE_TOP],
            [PLATE_RIGHT, PLATE_BOTTOM], [PLATE_LEFT, PLATE_BOTTOM],
        ], np.float32
    )  # fmt: skip
    target = (plate_corners + 0.5) * samples - 0.5
    transform: Any = cv2.getPerspectiveTransform(target.astype(np.float32), np.array(corners, np.float32))
    size = (STRIP_COLUMNS * samples, STRIP_ROWS * samples)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    fine = cv2.warpPerspective(gray, transform, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    cells = fine.reshape(STRIP_ROWS, samples, STRIP_COLUMNS, samples)
    return _stretched(cells.mean(axis=(1, 3), dtype=np.float32))


def _is_plate(corners: Corners) -> bool:
    """Return True if the corners go clockwise (with rows downward) around a convex area of some pixels."""
    if not all(math.isfinite(x) and abs(x) < _MAX_COORDINATE for corner in corners for x in corner):
        return False
    turns = []
    for i in range(4):
        (ax, ay), (bx, by), (cx, cy) = (corners[(i + k) % 4] for k in range(3))
        turns.append((bx - ax) * (cy - by) - (by - ay) * (cx - bx))
    is_upright = corners[0][0] < corners[1][0] and corners[0][1] < corners[3][1]
    return is_upright and min(turns) > 0.0 and sum(turns) / 4.0 >= _MIN_AREA


def _samples(corners: Corners) -> int:
    """Return the number of samples per pixel of the strip in each direction."""
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = corners
    width = max(math.hypot(bx - ax, by - ay), math.hypot(cx - dx, cy - dy))
    height = max(math.hypot(dx - ax, dy - ay), math.hypot(cx - bx, cy - by))
    scale = max(width / (PLATE_RIGHT - PLATE_LEFT), height / (PLATE_BOTTOM - PLATE_TOP))
    return max(1, min(_MAX_SAMPLES, math.ceil(scale)))


def _stretched(strip: Floats) -> Floats:
    centered = strip - strip.mean()
    stretched: Floats = centered / np.float32(max(float(centered.std()), MIN_CONTRAST))
    return stretched
