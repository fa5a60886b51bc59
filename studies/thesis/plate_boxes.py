"""PlFinder as printed: detects plates by closed borders with corners (thesis section 5.7).

The negative of the image is stretched, which makes plates bright, and thresholded. From each transition from
dark to bright on the middle row, or else on a row above it, the border is traced; the corners of its chain
code give a bounding box, which is a plate if it has about the size of one.

Not printed, and chosen here: the threshold, half of the scale; the sizes that are accepted, those of a plate
from 0.8 to 2.6 m away, at up to 50 degrees; that a box needs four corners.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.signs import PLATE_HEIGHT_MM, PLATE_WIDTH_MM
from colony.vision.detections import PlateBox
from colony.vision.gray_images import Gray, gray_band
from colony.vision.level_camera import LevelCamera
from colony.vision.plates.search import MAX_TILT_DEG
from studies.thesis.chain_code import corners, trace_border

SCAN_LINES = 40
"""Number of rows around the middle that are searched, of an image of 120."""

MIDDLE_LEVEL, LOWER_EXPONENT, UPPER_EXPONENT = 0.8 * 255.0, 5.0, 0.5
"""M, e1 and e2 of the gray-level stretch."""

THRESHOLD = 128

NEAREST_MM, FARTHEST_MM = 800.0, 2600.0
_MIN_CORNERS = 4


def scan_band(camera: LevelCamera) -> tuple[int, int]:
    """Return the first of the rows that are searched, and their number."""
    count = min(camera.rows, round(SCAN_LINES * camera.rows / 120))
    return (camera.rows - count) // 2, count


def stretch(level: float) -> float:
    """Return the gray level that a level of the negative becomes; 0 stays 0."""
    if level <= MIDDLE_LEVEL:
        return float((level / MIDDLE_LEVEL) ** LOWER_EXPONENT * MIDDLE_LEVEL)
    above = 255.0 - MIDDLE_LEVEL
    return float(((level - MIDDLE_LEVEL) / above) ** UPPER_EXPONENT * above + MIDDLE_LEVEL)


_BRIGHT = np.array([stretch(255.0 - level) >= THRESHOLD for level in range(256)])
"""Table by gray level: True if the level becomes bright."""


def thesis_plates(
    band: NDArray[Any], camera: LevelCamera | None = None, *, first_row: int = 0, starting_column: int = 0
) -> tuple[PlateBox, ...]:
    """Return the plates in a band of an image, from left to right.

    Args:
        band: an image or a band of rows, as for `detector.find_plates`; only its scan lines are searched.
        camera: the camera; the default has a field of view of 60 degrees.
        first_row: first row of the band in the whole image. Corners are relative to the band.
        starting_column: first column to search; those to the left were searched in an earlier image.

    Raises:
        ValueError: `band` is not an image, or not one of this camera.
    """
    gray, camera = gray_band(band, camera, first_row)
    first, count = scan_band(camera)
    top = max(first - first_row, 0)
    lines = gray[top : first + count - first_row]
    middle = (camera.rows - 1) // 2 - first_row - top
    if not 0 <= middle < len(lines):
        return ()
    return tuple(plate.shifted_down(top) for plate in _plates(lines, middle, camera, starting_column))


def _plates(lines: Gray, middle: int, camera: LevelCamera, starting_column: int) -> Iterator[PlateBox]:
    binary = _BRIGHT[lines]
    next_column = starting_column
    for column, row in _transitions(binary, middle):
        if column < next_column:
            continue
        border = trace_border(binary, column, row)
        if border is None:
            continue
        found = corners(border)
        if len(found) >= _MIN_CORNERS and (plate := _plate(found, camera)) is not None:
            next_column = math.ceil(plate.corners[1][0])
            yield plate


def _transitions(binary: NDArray[np.bool_], middle: int) -> list[tuple[int, int]]:
    """Return the changes from dark to bright, from left to right.

    They are those of the middle row, or else of the lowest row above it that has any.
    """
    rising = ~binary[:, :-1] & binary[:, 1:]
    for row in range(middle, -1, -1):
        columns = (np.flatnonzero(rising[row]) + 1).tolist()
        if columns:
            return [(column, row) for column in columns]
    return []


def _plate(found: NDArray[np.int64], camera: LevelCamera) -> PlateBox | None:
    """Return the bounding box of corners, if it has the size of a plate."""
    left, top = (float(n) - 0.5 for n in found.min(axis=0))
    right, bottom = (float(n) + 0.5 for n in found.max(axis=0))
    nearest, farthest = camera.focal / NEAREST_MM, camera.focal / FARTHEST_MM
    narrowest = math.cos(math.radians(MAX_TILT_DEG)) * PLATE_WIDTH_MM
    if not farthest * PLATE_HEIGHT_MM <= bottom - top <= nearest * PLATE_HEIGHT_MM:
        return None
    if not farthest * narrowest <= right - left <= nearest * PLATE_WIDTH_MM:
        return None
    return PlateBox(((left, top), (right, top), (right, bottom), (left, bottom)), 1.0)
