"""Draws detections into the image in which they were found."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from colony.vision.detectors import Detection, Detector
from colony.vision.image_files import MAX_PIXELS, MAX_SIDE, Rgb

MIN_COLUMNS = 480
"""Minimum width of a drawn image: smaller ones are enlarged, so that their labels are legible."""

_COLORS = {Detector.PLATES: (40, 220, 60), Detector.MARKERS: (255, 150, 0), Detector.LIGHTS: (255, 60, 200)}
"""Colors as red, green and blue."""

_SUBPIXEL_BITS = 4


def annotate(image: Rgb, found: Iterable[tuple[Detector, Detection]]) -> Rgb:
    """Return the image with the outline of each detection and its label above it, (rows, columns, 3).

    An image of less than 480 columns is enlarged by a whole number, up to the maximum size of an image.
    """
    import cv2

    rows, columns = image.shape[:2]
    max_factor = min(math.isqrt(MAX_PIXELS // (rows * columns)), MAX_SIDE // max(rows, columns))
    factor = max(1, min(-(-MIN_COLUMNS // columns), max_factor))
    canvas = np.ascontiguousarray(image.repeat(factor, axis=0).repeat(factor, axis=1))
    for detector, detection in found:
        corners = (np.array(detection.corners) + 0.5) * factor - 0.5
        fixed_point = np.rint(np.clip(corners, -1e4, 1e4 + canvas.shape[1]) * 2**_SUBPIXEL_BITS).astype(
            np.int32
        )
        color, thickness = _COLORS[detector], max(1, canvas.shape[1] // 480)
        cv2.polylines(canvas, [fixed_point], True, color, thickness, cv2.LINE_AA, _SUBPIXEL_BITS)
        _write(canvas, label_of(detector, detection), corners, color)
    return canvas


def label_of(detector: Detector, detection: Detection) -> str:
    """Return the label of a detection, in a few letters."""
    match detector:
        case Detector.PLATES:
            return detection.label or "plate"
        case Detector.MARKERS:
            return detection.label
        case Detector.LIGHTS:
            return "light"


def encode_png(image: Rgb) -> bytes:
    """Encode an image as a PNG file."""
    import cv2

    _, data = cv2.imencode(".png", image[:, :, ::-1])
    return bytes(data)


def _write(canvas: Rgb, text: str, corners: NDArray[Any], color: tuple[int, int, int]) -> None:
    """Write text above a detection on a black background, kept within the image."""
    import cv2

    rows, columns = canvas.shape[:2]
    font_scale = max(0.45, columns / 1600)
    (width, height), baseline = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, font_scale, 1)
    left = int(np.clip(corners[:, 0].min(), 0, max(columns - width, 0)))
    bottom = int(np.clip(corners[:, 1].min() - 4, height + baseline, rows - baseline))
    cv2.rectangle(
        canvas, (left, bottom - height - 2), (left + width, bottom + baseline), (0, 0, 0), cv2.FILLED
    )
    cv2.putText(canvas, text, (left, bottom), cv2.FONT_HERSHEY_SIMPLEX, font_scale, color, 1, cv2.LINE_AA)
