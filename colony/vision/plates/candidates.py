"""Candidates for plates in an image: dark patches on the horizon with about the shape of a plate.

A level camera at the height of the plates' centers sees each plate symmetrically about its horizon, at any
distance and angle. This rules out most dark patches. Patches are dark below one of several thresholds, as no
single one suits both a dim corridor and a sunlit wall: a plate is dark at many of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from colony.vision.gray_images import Gray
from colony.vision.plates.patches import Patch, merge_patches

LEVELS = 10
"""Number of thresholds, between the darkest and the middle gray of the image."""

MIN_HEIGHT = 7
"""Minimum height of a candidate, in pixels of an image 240 columns wide: a plate 3.7 m away."""

MIN_ASPECT, MAX_ASPECT = 0.9, 4.2
"""Range of width / height: 2.8 for a plate seen straight on, 1.6 at 50 degrees, with some tolerance."""

MIN_SPAN = 10
"""Minimum difference of gray levels between dark and bright; an image with less has no candidates."""

_MIN_FILL = 0.3  # of the bounding box: the characters may be excluded


def candidates(gray: Gray, horizon: float) -> tuple[Patch, ...]:
    """Return the dark patches that may be plates, those found at the most thresholds first.

    Args:
        gray: an image, or a band of one, about 240 columns wide.
        horizon: the row at the height of the camera, in this image.
    """
    import cv2

    darkest, middle = (float(level) for level in np.percentile(gray[::2, ::2], (0.5, 70.0)))
    if middle - darkest < MIN_SPAN:
        return ()
    # Opening removes bright strokes as thin as those of distant characters, so that they do not break through
    # the thin margin around them.
    opened = cv2.morphologyEx(gray, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    found: list[Patch] = []
    for number, level in enumerate(np.linspace(darkest, middle, LEVELS + 2)[1:-1].tolist()):
        for image in (opened, gray)[: 1 + number % 2]:
            dark = (image <= level).view(np.uint8)
            stats = cv2.connectedComponentsWithStats(dark, connectivity=4, ltype=cv2.CV_16U)[2]
            for box in stats[1:][_is_likely(stats[1:], gray.shape[1], gray.shape[0], horizon)].tolist():
                left, top, width, height, _ = box
                found.append(Patch(left, top, left + width, top + height))
    return merge_patches(found)


def _is_likely(stats: NDArray[np.int32], columns: int, rows: int, horizon: float) -> NDArray[np.bool_]:
    """Return a mask of the components, (n, 5) as from OpenCV, with about a plate's shape and position."""
    left, top, width, height, area = stats.T
    offset = np.abs(top + (height - 1) / 2.0 - horizon)
    likely = (height >= MIN_HEIGHT) & (width >= MIN_ASPECT * height) & (width <= MAX_ASPECT * height)
    likely &= (left > 0) & (top > 0) & (left + width < columns) & (top + height < rows)
    likely &= (offset <= 1.5 + 0.08 * height) & (area >= _MIN_FILL * width * height)
    return np.asarray(likely, dtype=np.bool_)
