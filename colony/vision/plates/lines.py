"""Candidates for lines of white characters on a plate in an image.

A plate in front of or beside something dark, as on a wall of glass bricks, is not a separate dark patch. Its
characters are still bright patches of equal height on the horizon, side by side. Their height gives that of
the plate, and their center is the plate's center.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.signs import CHARACTER_HEIGHT_MM, PLATE_HEIGHT_MM, PLATE_WIDTH_MM
from colony.vision.gray_images import Gray
from colony.vision.plates.outline import Outline
from colony.vision.plates.patches import Patch, merge_patches

LEVELS = 8
"""Number of thresholds, between the darkest and the brightest gray of the image."""

MIN_HEIGHT = 5
"""Minimum height of characters, in pixels of an image 240 columns wide."""

MAX_LINE_ASPECT = 3.6
"""Maximum width / height of a line of characters: a plate has no space for more."""

_MIN_SPAN = 10.0
_MIN_HEIGHT_RATIO = 0.72  # minimum ratio of the heights of two neighbors
_MAX_GAP_RATIO = 0.8  # maximum gap between neighbors / height
_MIN_ASPECT, _MAX_ASPECT = 0.1, 3.6  # range of width / height of a patch: an I, and merged characters


def lines_of_text(gray: Gray, horizon: float) -> tuple[Patch, ...]:
    """Return the lines of bright patches, those found at the most thresholds first.

    Args:
        gray: an image, or a band of one, about 240 columns wide.
        horizon: the row at the height of the camera, in this image.
    """
    import cv2

    darkest, brightest = (float(level) for level in np.percentile(gray[::2, ::2], (0.5, 98.0)))
    if brightest - darkest < _MIN_SPAN:
        return ()
    found: list[Patch] = []
    for level in np.linspace(darkest, brightest, LEVELS + 2)[1:-1].tolist():
        bright = (gray > level).view(np.uint8)
        stats = cv2.connectedComponentsWithStats(bright, connectivity=4, ltype=cv2.CV_16U)[2][1:]
        found += _lines(stats[_is_likely(stats, gray.shape[0], horizon)], gray.shape[1])
    return merge_patches(found)


def outline_about(line: Patch, tilt_deg: float | None, focal: float, middle_column: float) -> Outline:
    """Return the outline of the plate with this line of characters, on a wall with the given tilt."""
    height = (line.bottom - line.top) * PLATE_HEIGHT_MM / CHARACTER_HEIGHT_MM
    middle, row = (line.left + line.right - 1) / 2.0, (line.top + line.bottom - 1) / 2.0
    tangent = float(np.tan(np.radians(0.0 if tilt_deg is None else tilt_deg)))
    u = (middle - middle_column) / focal
    width = height * PLATE_WIDTH_MM / PLATE_HEIGHT_MM * (1.0 + u * tangent) / float(np.hypot(1.0, tangent))
    # Along the wall 1 / depth, and so the height in the image, is linear in the column.
    growth = tangent * width / focal / max(1.0 + u * tangent, 0.2)
    left, right = height * (1.0 - growth / 2.0) / 2.0, height * (1.0 + growth / 2.0) / 2.0
    return Outline(
        left=middle - width / 2.0, right=middle + width / 2.0,
        left_top=row - left, left_bottom=row + left, right_top=row - right, right_bottom=row + right,
        spread=0.0,
    )  # fmt: skip


def _is_likely(stats: NDArray[np.int32], rows: int, horizon: float) -> NDArray[np.bool_]:
    """Return a mask of the components, (n, 5) as from OpenCV, that may be characters, single or merged."""
    _, top, width, height, _ = stats.T
    offset = np.abs(top + (height - 1) / 2.0 - horizon)
    likely = (height >= MIN_HEIGHT) & (width >= _MIN_ASPECT * height) & (width <= _MAX_ASPECT * height)
    likely &= (top > 0) & (top + height < rows)
    likely &= offset <= 1.0 + 0.12 * height
    return np.asarray(likely, dtype=np.bool_)


def _lines(stats: NDArray[np.int32], columns: int) -> list[Patch]:
    """Join neighbors of the same height to lines; leave out lines that extend beyond the image."""
    patches = sorted((x, y, x + w, y + h) for x, y, w, h, _ in stats.tolist())
    lines: list[Patch] = []
    for left, top, right, bottom in patches:
        patch = Patch(left, top, right, bottom)
        for number, line in enumerate(lines):
            if _is_next(line, patch):
                lines[number] = Patch(line.left, min(line.top, top), right, max(line.bottom, bottom))
                break
        else:
            lines.append(patch)
    return [
        line
        for line in lines
        if line.left > 0
        and line.right < columns
        and line.right - line.left <= MAX_LINE_ASPECT * (line.bottom - line.top)
    ]


def _is_next(line: Patch, patch: Patch) -> bool:
    """Return True if a patch continues a line."""
    low, high = sorted((line.bottom - line.top, patch.bottom - patch.top))
    return low >= _MIN_HEIGHT_RATIO * high and -0.3 * high <= patch.left - line.right <= _MAX_GAP_RATIO * high
