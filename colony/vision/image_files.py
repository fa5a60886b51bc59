"""Decoding of image files: PNG, JPEG, BMP, WebP or TIFF.

Images are gray or in color, with 8 or 16 bits per channel, with or without transparency. The message about a
file that is not an image, is damaged, or is too large is one line.
"""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from colony.text.wording import listed
from colony.vision.detectors import Detection, Detector
from colony.vision.gray_images import MIN_PIXELS

if TYPE_CHECKING:
    from PIL import Image


Rgb = NDArray[np.uint8]
"""An image: (rows, columns, 3), each channel from 0 to 255."""

MAX_BYTES = 64 * 2**20
"""Maximum size of a file, in bytes."""

MAX_PIXELS, MAX_SIDE = 50_000_000, 30_000
"""Maximum size of an image: total number of pixels, and number of rows or columns."""

_AT_MOST = f"at most {MAX_PIXELS // 10**6} million"
_FORMATS = ("PNG", "JPEG", "BMP", "WEBP", "TIFF")


class ImageFormatError(ValueError):
    """The bytes are not a usable image; the message says why."""


def decode_image(data: bytes) -> Rgb:
    """Decode an image file; apply its orientation tag, and put a white background behind transparent pixels.

    A file with several images gives the first one. Levels of 16 bits are reduced to 8.

    Raises:
        ImageFormatError: the file has no image, or the image is damaged, too large or too small.
    """
    from PIL import Image, ImageOps, UnidentifiedImageError

    if not data:
        raise ImageFormatError("the file is empty; expected an image")
    if len(data) > MAX_BYTES:
        raise ImageFormatError(f"more than {MAX_BYTES // 2**20} MB; expected a smaller image file")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about oddities of files that are still readable
        try:
            with Image.open(io.BytesIO(data), formats=_FORMATS) as file:
                _check_size(*file.size)
                file.load()
                return _rgb(ImageOps.exif_transpose(file))
        except ImageFormatError:
            raise
        except UnidentifiedImageError:
            expected = listed(_FORMATS, "or")
            raise ImageFormatError(f"not a readable image; expected {expected}") from None
        except Image.DecompressionBombError:
            raise ImageFormatError(f"an image of far more pixels than expected: {_AT_MOST}") from None
        # For damaged data, decoders raise errors of many kinds: from zlib, from struct, IndexError.
        except Exception as problem:
            why = str(problem).splitlines()
            raise ImageFormatError(
                f"the image is damaged: {why[0] if why else type(problem).__name__}"
            ) from None


def _check_size(columns: int, rows: int) -> None:
    size = f"an image of {columns} x {rows} pixels"
    if columns * rows > MAX_PIXELS:
        raise ImageFormatError(f"{size}; expected {_AT_MOST}")
    if max(columns, rows) > MAX_SIDE:
        raise ImageFormatError(f"{size}; expected at most {MAX_SIDE} a side")
    if min(columns, rows) < MIN_PIXELS:
        raise ImageFormatError(f"{size}; expected at least {MIN_PIXELS} x {MIN_PIXELS}")


def _rgb(image: Image.Image) -> Rgb:
    """Convert any kind of pixels to red, green and blue of 8 bits."""
    from PIL import Image

    if image.mode == "F" or image.mode.startswith("I"):
        return np.repeat(_to_8_bits(np.asarray(image))[:, :, None], 3, axis=2)
    if image.has_transparency_data:
        white = Image.new("RGBA", image.size, (255, 255, 255, 255))
        image = Image.alpha_composite(white, image.convert("RGBA"))
    return np.array(image.convert("RGB"))


def _to_8_bits(levels: NDArray[np.generic]) -> NDArray[np.uint8]:
    """Convert 16-bit levels, or floats from 0 to 1, to 8 bits."""
    values = np.nan_to_num(levels.astype(np.float64))
    is_fraction = np.issubdtype(levels.dtype, np.floating) and values.max(initial=0.0) <= 1.0
    white = 1.0 if is_fraction else 65535.0 if values.max(initial=0.0) > 255.0 else 255.0
    result: NDArray[np.uint8] = np.rint(np.clip(values / white, 0.0, 1.0) * 255.0).astype(np.uint8)
    return result


# --- annotate -----------------------------------------------------------------------------------------
#
# Draws detections into the image in which they were found.

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
