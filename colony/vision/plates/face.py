"""The features that distinguish the face of a door plate from other things in an outline.

A plate has one line of white characters of a fixed height on black, with a black margin, on a lighter
background. The outline is first rectified to millimeters, as if it were a plate. This exposes
posters: their lines are too many or not tall enough, their margins too narrow, or their ground uneven, or
they have no text.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.signs import CHARACTER_HEIGHT_MM, PLATE_HEIGHT_MM, PLATE_WIDTH_MM
from colony.vision.gray_images import Gray
from colony.vision.plates.outline import Outline

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
