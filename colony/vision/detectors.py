"""Runs all detectors on one image of any size, for `colony vision`.

Plates and markers are detected as if a level camera had taken the image, lights as if the ceiling camera had.
Large images are reduced first; positions refer to the original image.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Set
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from colony.nav.maps.signs import MARKER_BITS
from colony.vision.detections import Corner, PlateReading
from colony.vision.gray_images import MIN_PIXELS, Gray, gray_image
from colony.vision.lights.ceiling_camera import LIGHT_LENGTH_MM, UPWARD, CeilingCameraModel

MAX_COLUMNS, MAX_ROWS = 640, 2560
"""Maximum size of an image in which plates and markers are detected; larger images are reduced to it."""


class Detector(StrEnum):
    """A kind of detector."""

    PLATES = "plates"
    MARKERS = "markers"
    LIGHTS = "lights"


class Detection(NamedTuple):
    """A detection in an image.

    Attributes:
        corners: corners clockwise from the upper left, in pixels of the image; pixel i extends from i - 0.5
            to i + 0.5.
        label: text of a plate, "" if it cannot be read; bits of a marker.
        confidence: confidence from 0 to 1 in a plate or a light; None for a marker.
        label_confidence: confidence from 0 to 1 in the text of a plate; None for other detections.
    """

    corners: tuple[Corner, Corner, Corner, Corner]
    label: str
    confidence: float | None
    label_confidence: float | None


class DetectorRun(NamedTuple):
    """The result of a detector run, and its duration."""

    detector: Detector
    found: tuple[Detection, ...]
    milliseconds: float


def run_detectors(image: Gray, chosen: Set[Detector]) -> Iterator[DetectorRun]:
    """Run the chosen detectors or, if none is chosen, all that apply.

    In the latter case lights are detected only if nothing else was found: an image shows a wall or the
    ceiling.
    """
    any_found = False
    for detector in Detector:
        if detector not in chosen if chosen else detector is Detector.LIGHTS and any_found:
            continue
        detect(detector, image)  # an untimed first run loads the code and weights of the detector
        start = time.perf_counter()
        found = detect(detector, image)
        yield DetectorRun(detector, found, (time.perf_counter() - start) * 1e3)
        any_found = any_found or bool(found)


def detect(detector: Detector, image: Gray) -> tuple[Detection, ...]:
    """Return a detector's detections in an image, the best first.

    Raises:
        ValueError: `image` is not (rows, columns) of uint8, or has fewer than 4 x 4 pixels.
    """
    gray = gray_image(image)
    rows, columns = gray.shape
    size = _working_size(detector, columns, rows)
    found = _DETECTORS[detector](_resized(gray, size))
    return tuple(_scaled(detection, columns / size[0], rows / size[1]) for detection in found)


def _working_size(detector: Detector, columns: int, rows: int) -> tuple[int, int]:
    """Return the columns and rows to which an image of this size is reduced for a detector."""
    if detector is Detector.LIGHTS:
        return UPWARD.columns, UPWARD.rows
    factor = min(1.0, MAX_COLUMNS / columns, MAX_ROWS / rows)
    return max(round(columns * factor), MIN_PIXELS), max(round(rows * factor), MIN_PIXELS)


def _resized(gray: Gray, size: tuple[int, int]) -> Gray:
    if (gray.shape[1], gray.shape[0]) == size:
        return gray
    import cv2

    smaller = size[0] <= gray.shape[1] and size[1] <= gray.shape[0]
    resized = cv2.resize(gray, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)
    return resized.astype(np.uint8, copy=False)


def _scaled(detection: Detection, column_factor: float, row_factor: float) -> Detection:
    """Scale a detection to an image whose columns and rows are multiplied by these factors."""
    first, second, third, fourth = (
        ((column + 0.5) * column_factor - 0.5, (row + 0.5) * row_factor - 0.5)
        for column, row in detection.corners
    )
    return detection._replace(corners=(first, second, third, fourth))


def _plates(gray: Gray) -> tuple[Detection, ...]:
    from colony.vision.plates.detector import find_plates
    from colony.vision.plates.reader import read_plate

    found: list[Detection] = []
    for box in find_plates(gray):
        reading: PlateReading = read_plate(gray, box)
        found.append(Detection(box.corners, reading.text, box.score, reading.confidence))
    return tuple(found)


def _markers(gray: Gray) -> tuple[Detection, ...]:
    from colony.vision.markers.rows import find_markers

    found: list[Detection] = []
    for box in find_markers(gray):
        left, right, top, bottom = box.left, box.right, box.first_row - 0.5, box.last_row + 0.5
        corners = (left, top), (right, top), (right, bottom), (left, bottom)
        found.append(Detection(corners, format(box.code, f"0{MARKER_BITS}b"), None, None))
    return tuple(found)


def _lights(gray: Gray) -> tuple[Detection, ...]:
    from colony.vision.lights.scan_lines import ceiling_lights

    found: list[Detection] = []
    for light in ceiling_lights(gray[list(UPWARD.scan_rows)], UPWARD):
        tilt = math.radians(light.tilt_deg or 0.0)
        near, far = (light.ahead_mm + half for half in (-LIGHT_LENGTH_MM / 2.0, LIGHT_LENGTH_MM / 2.0))
        top, bottom = -0.5, UPWARD.rows - 0.5
        corners = tuple(
            (_column_of_line(UPWARD, along, tilt, row), row)
            for along, row in ((near, top), (far, top), (far, bottom), (near, bottom))
        )
        found.append(Detection((corners[0], corners[1], corners[2], corners[3]), "", light.quality, None))
    return tuple(found)


def _column_of_line(camera: CeilingCameraModel, along_mm: float, tilt: float, row: float) -> float:
    """Return the column at which a line across the corridor is in a row, clipped to the image."""
    ahead_mm = (along_mm + camera.left_of(row) * math.sin(tilt)) / math.cos(tilt)
    return min(max(camera.column_of(ahead_mm), -0.5), camera.columns - 0.5)


_DETECTORS: dict[Detector, Callable[[Gray], tuple[Detection, ...]]] = {
    Detector.PLATES: _plates,
    Detector.MARKERS: _markers,
    Detector.LIGHTS: _lights,
}
