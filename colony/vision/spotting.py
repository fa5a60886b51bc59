"""All detectors, on one image of any size, as `colony vision` runs them on a picture.

Plates and markers are searched as in an image of a camera that looks along the floor, lights as in one of the
camera that looks up. Large images are reduced for it; places are given in the original image.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Set
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from colony.nav.maps.signs import MARKER_BITS
from colony.vision.gray_images import LEAST_PIXELS, Gray, gray_image
from colony.vision.lights.ceiling_camera import LIGHT_LENGTH_MM, UPWARD, CeilingCamera
from colony.vision.sightings import Corner, Reading

MOST_COLUMNS, MOST_ROWS = 640, 2560
"""Largest size of an image in which plates and markers are searched; larger ones are reduced to it."""


class Detector(StrEnum):
    """A detector."""

    PLATES = "plates"
    MARKERS = "markers"
    LIGHTS = "lights"


class Spot(NamedTuple):
    """Something that a detector found.

    Attributes:
        corners: from the upper left one clockwise, in pixels of the image; pixel i reaches from i - 0.5 to
            i + 0.5.
        label: what is on it: the text of a plate, "" where it cannot be read; the bits of a marker.
        confidence: from 0 to 1, that there is a plate or a light; None for a marker, which is one or is none.
        label_confidence: from 0 to 1, that the text is right; None for all but plates.
    """

    corners: tuple[Corner, Corner, Corner, Corner]
    label: str
    confidence: float | None
    label_confidence: float | None


class Look(NamedTuple):
    """The result of a detector, and its duration."""

    detector: Detector
    found: tuple[Spot, ...]
    milliseconds: float


def looks_at(image: Gray, chosen: Set[Detector]) -> Iterator[Look]:
    """Run the chosen detectors or, if none is chosen, all that make sense.

    A ceiling has no plates and markers, and a wall no ceiling lights: lights are searched only if nothing
    else is found.
    """
    seen = False
    for detector in Detector:
        if detector not in chosen if chosen else detector is Detector.LIGHTS and seen:
            continue
        spots(detector, image)  # loads what the detector needs, which is not its time
        start = time.perf_counter()
        found = spots(detector, image)
        yield Look(detector, found, (time.perf_counter() - start) * 1e3)
        seen = seen or bool(found)


def spots(detector: Detector, image: Gray) -> tuple[Spot, ...]:
    """Return what a detector finds in an image, the best first.

    Raises:
        ValueError: it is no (rows, columns) of uint8, or has less than 4 x 4 pixels.
    """
    gray = gray_image(image)
    rows, columns = gray.shape
    size = _looked_at(detector, columns, rows)
    found = _LOOKS[detector](_resized(gray, size))
    return tuple(_scaled(spot, columns / size[0], rows / size[1]) for spot in found)


def _looked_at(detector: Detector, columns: int, rows: int) -> tuple[int, int]:
    """Return the columns and rows to which an image of this size is reduced for a detector."""
    if detector is Detector.LIGHTS:
        return UPWARD.columns, UPWARD.rows
    factor = min(1.0, MOST_COLUMNS / columns, MOST_ROWS / rows)
    return max(round(columns * factor), LEAST_PIXELS), max(round(rows * factor), LEAST_PIXELS)


def _resized(gray: Gray, size: tuple[int, int]) -> Gray:
    if (gray.shape[1], gray.shape[0]) == size:
        return gray
    import cv2

    smaller = size[0] <= gray.shape[1] and size[1] <= gray.shape[0]
    resized = cv2.resize(gray, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)
    return resized.astype(np.uint8, copy=False)


def _scaled(spot: Spot, across: float, down: float) -> Spot:
    """Scale a spot to an image that has so many times as many columns and rows."""
    first, second, third, fourth = (
        ((column + 0.5) * across - 0.5, (row + 0.5) * down - 0.5) for column, row in spot.corners
    )
    return spot._replace(corners=(first, second, third, fourth))


def _plates(gray: Gray) -> tuple[Spot, ...]:
    from colony.vision.plates.detector import find_plates
    from colony.vision.plates.reader import read_plate

    found: list[Spot] = []
    for box in find_plates(gray):
        reading: Reading = read_plate(gray, box)
        found.append(Spot(box.corners, reading.text, box.score, reading.confidence))
    return tuple(found)


def _markers(gray: Gray) -> tuple[Spot, ...]:
    from colony.vision.markers.rows import find_markers

    found: list[Spot] = []
    for box in find_markers(gray):
        left, right, top, bottom = box.left, box.right, box.first_row - 0.5, box.last_row + 0.5
        corners = (left, top), (right, top), (right, bottom), (left, bottom)
        found.append(Spot(corners, format(box.code, f"0{MARKER_BITS}b"), None, None))
    return tuple(found)


def _lights(gray: Gray) -> tuple[Spot, ...]:
    from colony.vision.lights.scan_lines import ceiling_lights

    found: list[Spot] = []
    for light in ceiling_lights(gray[list(UPWARD.scan_rows)], UPWARD):
        tilt = math.radians(light.tilt_deg or 0.0)
        near, far = (light.ahead_mm + half for half in (-LIGHT_LENGTH_MM / 2.0, LIGHT_LENGTH_MM / 2.0))
        top, bottom = -0.5, UPWARD.rows - 0.5
        corners = tuple(
            (_column_of_line(UPWARD, along, tilt, row), row)
            for along, row in ((near, top), (far, top), (far, bottom), (near, bottom))
        )
        found.append(Spot((corners[0], corners[1], corners[2], corners[3]), "", light.quality, None))
    return tuple(found)


def _column_of_line(camera: CeilingCamera, along_mm: float, tilt: float, row: float) -> float:
    """Return the column of a line across the corridor in a row; the image's rim if it is beyond it."""
    ahead_mm = (along_mm + camera.left_of(row) * math.sin(tilt)) / math.cos(tilt)
    return min(max(camera.column_of(ahead_mm), -0.5), camera.columns - 0.5)


_LOOKS: dict[Detector, Callable[[Gray], tuple[Spot, ...]]] = {
    Detector.PLATES: _plates,
    Detector.MARKERS: _markers,
    Detector.LIGHTS: _lights,
}
