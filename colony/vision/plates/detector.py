"""Finds door plates in an image of a level camera at their height.

Dark patches on the horizon are candidates (`outline.py`). The outline of each is measured with subpixel
accuracy (`outline.py`); it must be a possible view of a plate of 356 x 127 mm, and its content must look like
that of a plate (`detector.py`). No map is needed; the angle of the camera to the wall is used if known.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.signs import CHARACTER_HEIGHT_MM, PLATE_HEIGHT_MM, PLATE_WIDTH_MM
from colony.vision.detections import PlateBox
from colony.vision.gray_images import MIN_PIXELS, Gray, gray_band
from colony.vision.level_camera import LevelCamera
from colony.vision.plates.outline import (
    Outline,
    candidates,
    lines_of_text,
    outline_about,
    outline_near,
    outline_of,
)

# --- face ---------------------------------------------------------------------------------------------
#
# The features that distinguish the face of a door plate from other things in an outline.
#
# A plate has one line of white characters of a fixed height on black, with a black margin, on a lighter
# background. The outline is first rectified to millimeters, as if it were a plate. This exposes
# posters: their lines are too many or not tall enough, their margins too narrow, or their ground uneven, or
# they have no text.

Floats = NDArray[np.float64]

MM_PER_PIXEL = 4.0
BORDER_MM = 32.0
"""Width of the border around the plate that is rectified with it."""

MIN_CONTRAST = 12.0
"""Minimum difference of gray levels between the characters and the ground."""

_BLUR_PIXELS = 2.2  # width of the ramp at an edge, in pixels of the image
_BORDER = round(BORDER_MM / MM_PER_PIXEL)
_COLUMNS, _ROWS = round(PLATE_WIDTH_MM / MM_PER_PIXEL), round(PLATE_HEIGHT_MM / MM_PER_PIXEL)
_MARGIN_MM = (PLATE_HEIGHT_MM - CHARACTER_HEIGHT_MM) / 2.0
_MARGIN = round(_MARGIN_MM / MM_PER_PIXEL)
_BLURS = 16
_DARK, _LIGHT = 0.15, 0.985  # quantiles of the pixels: a single character covers a fiftieth of a plate
_OUTSIDE = 4  # pixels from the outline to the background
_MIN_STEP = 0.15


class Face(NamedTuple):
    """The features of a plate's face. Brightness is relative to the contrast.

    Attributes:
        contrast: difference between the characters and the ground, in gray levels.
        ground: brightness between the characters, as a fraction of that of the characters.
        edge_fraction: fraction of the outline along which the background is lighter.
        ink: mean brightness of the line of characters, which is the fraction covered by them.
        misfit: rms difference of the rows from those of a plate, as a fraction of `ink`.
        gap: brightness of the darkest row of the line of characters, as a fraction of their mean.
        rim: brightness of the lightest parts of the margin around the characters.
        center: center of the text, from 0 at the left edge of the plate to 1 at the right.
        width: width of the text, as a fraction of the plate's.
    """

    contrast: float
    ground: float
    edge_fraction: float
    ink: float
    misfit: float
    gap: float
    rim: float
    center: float
    width: float


def face_of(gray: Gray, outline: Outline) -> Face | None:
    """Return the face within an outline; None without contrast."""
    patch = _rectified(gray, outline)
    plate = patch[_BORDER : _BORDER + _ROWS, _BORDER : _BORDER + _COLUMNS]
    ordered = np.sort(plate, axis=None)
    ground, light = float(ordered[int(_DARK * ordered.size)]), float(ordered[int(_LIGHT * ordered.size)])
    contrast = light - ground
    if contrast < MIN_CONTRAST:
        return None
    patch = (patch - ground) / contrast
    left, right = _text_columns(patch[_BORDER + _MARGIN : -_BORDER - _MARGIN, _BORDER : _BORDER + _COLUMNS])
    height = (outline.left_bottom - outline.left_top + outline.right_bottom - outline.right_top) / 2.0
    text = patch[:, _BORDER + left : _BORDER + right].mean(axis=1)
    ink, misfit = _fit(text, PLATE_HEIGHT_MM / height)
    line = text[_BORDER + _MARGIN + 2 : -_BORDER - _MARGIN - 2]
    return Face(
        contrast=contrast,
        ground=ground / light,
        edge_fraction=_edge_fraction(patch),
        ink=ink,
        misfit=misfit / max(ink, 0.05),
        gap=float(line.min() / max(line.mean(), 0.05)),
        rim=_rim(patch),
        center=(left + right) / 2.0 / _COLUMNS,
        width=(right - left) / _COLUMNS,
    )


def contrast_of(gray: Gray, outline: Outline) -> float:
    """Return the contrast between bright and dark within an outline, in gray levels."""
    left, right = max(math.ceil(outline.left), 0), max(math.floor(outline.right), 0) + 1
    top, bottom = max(math.ceil(outline.left_top), 0), max(math.floor(outline.left_bottom), 0) + 1
    within = np.sort(gray[top:bottom, left:right], axis=None)
    if within.size == 0:
        return 0.0
    return float(within[int(_LIGHT * within.size)]) - float(within[int(_DARK * within.size)])


def _rectified(gray: Gray, outline: Outline) -> Floats:
    """Rectify the plate with its surroundings."""
    import cv2

    near, right, lower = _BORDER - 0.5, _BORDER + _COLUMNS - 0.5, _BORDER + _ROWS - 0.5
    rectified_corners = np.array(
        [(near, near), (right, near), (right, lower), (near, lower)], dtype=np.float32
    )
    transform = cv2.getPerspectiveTransform(rectified_corners, np.array(outline.corners, dtype=np.float32))
    size = (_COLUMNS + 2 * _BORDER, _ROWS + 2 * _BORDER)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    patch = cv2.warpPerspective(gray, transform, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(patch, dtype=np.float64)


def _edge_fraction(patch: Floats) -> float:
    """Return the fraction of the outline along which the background is lighter than the margin."""
    rows, columns = slice(_BORDER, -_BORDER), slice(_BORDER, -_BORDER)
    inside, outside = _BORDER + _MARGIN // 2, _BORDER - _OUTSIDE
    steps = (
        patch[outside, columns] - patch[inside, columns],
        patch[-1 - outside, columns] - patch[-1 - inside, columns],
        patch[rows, outside] - patch[rows, inside],
        patch[rows, -1 - outside] - patch[rows, -1 - inside],
    )
    return float((np.concatenate(steps) >= _MIN_STEP).mean())


def _rim(patch: Floats) -> float:
    """Return the brightness in the middle of the margin, all around: the 90th percentile."""
    plate = patch[_BORDER:-_BORDER, _BORDER:-_BORDER]
    at = _MARGIN // 2
    rows, columns = slice(at, -at), slice(at, -at)
    ring = (plate[at, columns], plate[-1 - at, columns], plate[rows, at], plate[rows, -1 - at])
    return float(np.percentile(np.concatenate(ring), 90.0))


def _text_columns(line: Floats) -> tuple[int, int]:
    """Return the first column of the text, and the column after its last one."""
    columns = line[:, _MARGIN:-_MARGIN].mean(axis=0)
    level = 0.4 * float(np.sort(columns)[int(0.95 * columns.size)])
    written = np.flatnonzero(columns >= level)
    return _MARGIN + int(written[0]), _MARGIN + int(written[-1]) + 1


def _fit(rows: Floats, mm_per_pixel: float) -> tuple[float, float]:
    """Fit the rows of a plate to these rows.

    Returns:
        The brightness of the line of characters, and the rms of the residuals.
    """
    solver, basis = _plate_rows(min(max(round(mm_per_pixel), 1), _BLURS))
    amounts = solver @ rows
    residuals = rows - basis @ amounts
    inner_residuals = residuals[_BORDER // 2 : -_BORDER // 2]
    return float(amounts[0]), float(np.sqrt((inner_residuals * inner_residuals).mean()))


@lru_cache(maxsize=_BLURS)
def _plate_rows(mm_per_pixel: int) -> tuple[Floats, Floats]:
    """Return the components of the rows of a rectified plate, with the solver for their amounts.

    A pixel of the image is `mm_per_pixel` wide. The components are the line of characters, the area above
    the plate, the area below it, and the ground.
    """
    at = (np.arange(_ROWS + 2 * _BORDER) + 0.5) * MM_PER_PIXEL - BORDER_MM
    ramp = _BLUR_PIXELS * mm_per_pixel

    def after(edge: float) -> Floats:
        """Return 1 below an edge, 0 above it, and a ramp between."""
        return np.asarray(np.clip((at - edge) / ramp + 0.5, 0.0, 1.0))

    text = after(_MARGIN_MM) - after(PLATE_HEIGHT_MM - _MARGIN_MM)
    basis = np.stack([text, 1.0 - after(0.0), after(PLATE_HEIGHT_MM), np.ones_like(at)], axis=1)
    return np.linalg.pinv(basis), basis


# --- detector -----------------------------------------------------------------------------------------

MIN_SCORE = 0.4
"""Minimum score of a plate that is reported."""

SURE_SCORE = 0.9
"""Score from which a plate is not also detected by its line of text."""

MIN_EDGE_CONTRAST = 0.3
"""Minimum contrast of a visible edge of a plate, as a fraction of the contrast of its characters."""

NEAREST_MM = 450.0
"""Minimum distance of a plate: a nearer one is almost as high as the image."""

WORKING_COLUMNS = 240
"""Approximate width to which an image is reduced for the search for candidates."""

_MAX_DISTANCE_MM = 3_700.0


class PlateFit(NamedTuple):
    """The fit of an outline to a plate's shape.

    Attributes:
        depth_mm: distance of its center, from its height.
        width: relative excess over the width of a plate at that distance; negative for a narrower outline.
        slope: height of its right edge minus that of its left one, as a fraction of the height, minus the
            value expected on a wall with the given tilt.
        offset_px: distance of its center from the horizon, in pixels.
    """

    depth_mm: float
    width: float
    slope: float
    offset_px: float


def find_plates(
    image: NDArray[Any],
    camera: LevelCamera | None = None,
    *,
    first_row: int = 0,
    tilt_deg: float | None = None,
) -> tuple[PlateBox, ...]:
    """Return the plates in an image, by descending score.

    Args:
        image: (rows, columns) of gray, or (rows, columns, 3) of RGB, uint8: a whole image, or a band of rows.
        camera: the camera; the default has a field of view of 60 degrees and images of this size.
        first_row: first row of the band in the whole image. Corners are relative to the band.
        tilt_deg: angle between the optical axis and the wall's normal; None if unknown.

    Raises:
        ValueError: `image` is not an image, or not one of this camera.
    """
    gray, camera = gray_band(image, camera, first_row)
    horizon = (camera.rows - 1) / 2.0 - first_row
    half_height = camera.focal * PLATE_HEIGHT_MM / 2.0 / NEAREST_MM
    top, bottom = max(math.ceil(horizon - half_height), 0), math.floor(horizon + half_height) + 1
    band = gray[top:bottom]
    if len(band) < MIN_PIXELS:
        return ()
    plates = _without_overlaps(_plates(band, camera, horizon - top, tilt_deg))
    return tuple(plate.shifted_down(top) for plate in plates)


def _plates(gray: Gray, camera: LevelCamera, horizon: float, tilt_deg: float | None) -> list[PlateBox]:
    """Return the plates found as dark patches, and those found by their lines of text."""
    small, factor = _small(gray)
    row = (horizon - (factor - 1) / 2.0) / factor
    found: list[PlateBox] = []
    for box in candidates(small, row):
        patch = box.scaled(factor)
        if any(_overlap(patch.left, patch.right, plate) for plate in found if plate.score >= SURE_SCORE):
            continue
        outline = outline_of(gray, patch, horizon)
        if outline is not None:
            found += _plate(gray, outline, camera, horizon, tilt_deg)
    middle = (camera.columns - 1) / 2.0
    for line in lines_of_text(small, row):
        rough = outline_about(line.scaled(factor), tilt_deg, camera.focal, middle)
        if any(_overlap(rough.left, rough.right, plate) for plate in found if plate.score >= SURE_SCORE):
            continue
        if rough.left < 0.0 or rough.right > camera.columns - 1.0:
            continue
        outline = outline_near(gray, rough, horizon, MIN_EDGE_CONTRAST * contrast_of(gray, rough))
        found += _plate(gray, outline, camera, horizon, tilt_deg)
    return found


def _small(gray: Gray) -> tuple[Gray, int]:
    """Return the image reduced to about `WORKING_COLUMNS`, and the factor."""
    import cv2

    factor = max(1, round(gray.shape[1] / WORKING_COLUMNS))
    size = (gray.shape[1] // factor, gray.shape[0] // factor)
    if factor == 1 or min(size) < MIN_PIXELS:
        return gray, 1
    cropped = gray[: size[1] * factor, : size[0] * factor]
    return np.asarray(cv2.resize(cropped, size, interpolation=cv2.INTER_AREA), dtype=np.uint8), factor


def _plate(
    gray: Gray, outline: Outline, camera: LevelCamera, horizon: float, tilt_deg: float | None
) -> list[PlateBox]:
    """Return the plate within an outline, or nothing if it cannot be one."""
    fit = plate_fit(outline, camera, horizon, tilt_deg)
    if fit is None or not _fits(fit, outline):
        return []
    face = face_of(gray, outline)
    score = 0.0 if face is None else score_of(fit, face)
    return [PlateBox(outline.corners, score)] if score >= MIN_SCORE else []


def _overlap(left: float, right: float, plate: PlateBox) -> bool:
    return left < plate.corners[1][0] and plate.corners[0][0] < right


def plate_fit(
    outline: Outline, camera: LevelCamera, horizon: float, tilt_deg: float | None
) -> PlateFit | None:
    """Return the fit of an outline to a plate's shape; None if it is not a trapezoid."""
    left = outline.left_bottom - outline.left_top
    right = outline.right_bottom - outline.right_top
    if min(left, right) < 1.0:
        return None
    height = (left + right) / 2.0
    depth = camera.focal * PLATE_HEIGHT_MM / height
    ul = (outline.left - (camera.columns - 1) / 2.0) / camera.focal
    ur = (outline.right - (camera.columns - 1) / 2.0) / camera.focal
    tangent = math.tan(math.radians(0.0 if tilt_deg is None else tilt_deg))
    # Along a wall 1 / depth, and so the height in the image, is linear in the column.
    growth = tangent * (ur - ul) / max(1.0 + tangent * (ul + ur) / 2.0, 0.2)
    if tilt_deg is None:
        growth = min(max((right - left) / height, -0.3), 0.3)
    right_depth, left_depth = depth / (1.0 + growth / 2.0), depth / (1.0 - growth / 2.0)
    width = math.hypot(ur * right_depth - ul * left_depth, right_depth - left_depth)
    middle_row = (outline.left_top + outline.left_bottom + outline.right_top + outline.right_bottom) / 4.0
    return PlateFit(
        depth_mm=depth,
        width=width / PLATE_WIDTH_MM - 1.0,
        slope=(right - left) / height - growth,
        offset_px=abs(middle_row - horizon),
    )


def _fits(fit: PlateFit, outline: Outline) -> bool:
    """Return True if the outline is a possible view of a plate."""
    height = outline.left_bottom - outline.left_top
    return (
        fit.depth_mm <= _MAX_DISTANCE_MM
        and abs(fit.width) <= 0.3
        and abs(fit.slope) <= 0.3
        and fit.offset_px <= 1.0 + 0.05 * height
        and outline.spread <= 1.0 + 0.03 * height
    )


def score_of(fit: PlateFit, face: Face) -> float:
    """Return the score of a plate, from 0 to 1: the product of the scores of its features."""
    return (
        _within(fit.width, 0.0, 0.12, 0.25)
        * _within(fit.slope, 0.0, 0.12, 0.25)
        * _within(face.ground, 0.0, 0.5, 0.65)
        * _within(face.edge_fraction, 1.0, 0.5, 0.8)
        * _within(face.ink, 0.55, 0.35, 0.48)
        * _within(face.misfit, 0.0, 0.45, 0.65)
        * _within(face.gap, 1.0, 0.5, 0.7)
        * _within(face.rim, 0.0, 0.5, 0.7)
        * _within(face.center, 0.5, 0.05, 0.13)
    )


def _within(value: float, expected: float, good: float, bad: float) -> float:
    """Return 1 for a value within `good` of the expected one, 0 beyond `bad`, and linear between."""
    return min(max((bad - abs(value - expected)) / (bad - good), 0.0), 1.0)


def _without_overlaps(plates: Iterable[PlateBox]) -> tuple[PlateBox, ...]:
    """Keep the best of overlapping plates."""
    kept: list[PlateBox] = []
    for plate in sorted(plates, key=lambda plate: -plate.score):
        if not any(_overlap(plate.corners[0][0], plate.corners[1][0], other) for other in kept):
            kept.append(plate)
    return tuple(kept)
