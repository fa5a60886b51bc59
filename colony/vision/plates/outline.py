"""The outline of a dark patch as four lines, with subpixel accuracy.

The camera is level and walls are upright, so the left and the right edge are upright in the image, and the
upper and the lower one any straight lines. An edge is where the image gets darker toward the inside: at the
centroid of the gray-level steps from row to row or from column to column.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.signs import CHARACTER_HEIGHT_MM, PLATE_HEIGHT_MM, PLATE_WIDTH_MM
from colony.vision.detections import Corner
from colony.vision.gray_images import Gray

# --- patches ------------------------------------------------------------------------------------------
#
# Patches of an image at a threshold, and their merging over several thresholds.

MIN_OVERLAP = 0.62
"""Minimum intersection over union of patches that count as the same."""


class Patch(NamedTuple):
    """Columns from `left` to before `right`, rows from `top` to before `bottom`."""

    left: int
    top: int
    right: int
    bottom: int

    def scaled(self, factor: int) -> Patch:
        """Return the patch in an image that is `factor` times as large."""
        return Patch(self.left * factor, self.top * factor, self.right * factor, self.bottom * factor)

    @property
    def area(self) -> int:
        """Area in pixels."""
        return (self.right - self.left) * (self.bottom - self.top)


def merge_patches(found: Iterable[Patch]) -> tuple[Patch, ...]:
    """Merge patches that are nearly the same at several thresholds, those found most often first.

    The middle patch of each group is kept.

    Args:
        found: the patches, in the order of the thresholds.
    """
    groups: list[list[Patch]] = []
    for patch in found:
        group = next((group for group in groups if _is_same(patch, group[-1])), None)
        if group is None:
            groups.append([patch])
        else:
            group.append(patch)
    groups.sort(key=lambda group: -len(group))
    return tuple(group[len(group) // 2] for group in groups)


def _is_same(a: Patch, b: Patch) -> bool:
    width = min(a.right, b.right) - max(a.left, b.left)
    height = min(a.bottom, b.bottom) - max(a.top, b.top)
    if width <= 0 or height <= 0:
        return False
    return width * height >= MIN_OVERLAP * (a.area + b.area - width * height)


# --- outline ------------------------------------------------------------------------------------------

Floats = NDArray[np.float64]

MIN_DROP = 4.0
"""Minimum fall of the gray level across an edge."""

_MIN_COLUMNS = 4
_ROUNDS = 5
_MIN_VISIBLE = 0.35  # fraction of the columns of an edge
_SOFT_RESIDUAL = 0.35  # pixels: larger residuals are weighted down


class Outline(NamedTuple):
    """A trapezoid with upright sides: their columns, and the rows of their upper and lower ends.

    `spread` is the deviation of the upper and lower edge from straight lines, in pixels.
    """

    left: float
    right: float
    left_top: float
    left_bottom: float
    right_top: float
    right_bottom: float
    spread: float

    @property
    def middle_height(self) -> float:
        """The mean of its heights at the left and right side."""
        return (self.left_bottom - self.left_top + self.right_bottom - self.right_top) / 2.0

    @property
    def corners(self) -> tuple[Corner, Corner, Corner, Corner]:
        """Corners, clockwise from the upper left one."""
        return (
            (self.left, self.left_top),
            (self.right, self.right_top),
            (self.right, self.right_bottom),
            (self.left, self.left_bottom),
        )


def outline_of(gray: Gray, box: Patch, horizon: float) -> Outline | None:
    """Return the outline of a candidate, or None if an edge of it is not visible."""
    upper, lower = _edge(gray, box, lower=False), _edge(gray, box, lower=True)
    left, right = _side(gray, box, right=False), _side(gray, box, right=True)
    if upper is None or lower is None or left is None or right is None or right - left < _MIN_COLUMNS:
        return None
    return _trapezoid(left, right, _halves(upper, lower, horizon))


def outline_near(gray: Gray, rough: Outline, horizon: float, min_drop: float) -> Outline:
    """Refine an outline known to a pixel or two to subpixel accuracy, where its edges are visible.

    A missing upper or lower edge follows from the other, as they are symmetric about the horizon; a missing
    left or right one follows from the width. Edges whose fall is less than `min_drop` are not visible.
    """
    box = _box_about(rough, gray.shape)
    upper, lower = (_edge(gray, box, lower=lower, min_drop=min_drop) for lower in (False, True))
    if upper is None and lower is None:
        return rough
    halves = _halves(upper, lower, horizon)
    middle = (rough.left + rough.right) / 2.0
    width = (rough.right - rough.left) * 2.0 * halves.at(middle) / rough.middle_height
    left, right = (_side(gray, box, right=right, min_drop=min_drop) for right in (False, True))
    if left is None:
        left = middle - width / 2.0 if right is None else right - width
    return _trapezoid(left, left + width if right is None else right, halves)


class _Edge(NamedTuple):
    """An edge: its row in some columns."""

    columns: Floats
    rows: Floats


class _Halves(NamedTuple):
    """The upper and the lower half of a trapezoid.

    Their height is base + slope * column, about the row `center`; `spread` is the deviation of the edges from
    these lines.
    """

    center: float
    base: float
    slope: float
    spread: float

    def at(self, column: float) -> float:
        """Return the height of a half in a column."""
        return self.base + self.slope * column


def _halves(upper: _Edge | None, lower: _Edge | None, horizon: float) -> _Halves:
    """Fit one line to both edges, as they are symmetric about a row.

    If one is invisible against a dark background, the other suffices. Both may be off the horizon, as the
    camera need not be exactly level.
    """
    middle = horizon
    if upper is not None and lower is not None:
        middle = float(np.median(upper.rows) + np.median(lower.rows)) / 2.0
    columns = [edge.columns for edge in (upper, lower) if edge is not None]
    heights = [] if upper is None else [middle - upper.rows]
    heights += [] if lower is None else [lower.rows - middle]
    base, slope, spread = _line(np.concatenate(columns), np.concatenate(heights))
    return _Halves(middle, base, slope, spread)


def _trapezoid(left: float, right: float, halves: _Halves) -> Outline:
    middle, at_left, at_right = halves.center, halves.at(left), halves.at(right)
    return Outline(
        left=left, right=right,
        left_top=middle - at_left, left_bottom=middle + at_left,
        right_top=middle - at_right, right_bottom=middle + at_right,
        spread=halves.spread,
    )  # fmt: skip


def _box_about(outline: Outline, shape: tuple[int, ...]) -> Patch:
    top, bottom = (
        (outline.left_top + outline.right_top) / 2.0,
        (outline.left_bottom + outline.right_bottom) / 2.0,
    )
    return Patch(
        min(max(round(outline.left + 0.5), 0), shape[1]),
        min(max(round(top + 0.5), 0), shape[0]),
        min(max(round(outline.right + 0.5), 0), shape[1]),
        min(max(round(bottom + 0.5), 0), shape[0]),
    )


def _reach(box: Patch) -> int:
    """Return the distance within which an edge is searched for, in pixels."""
    return max(2, round(0.22 * (box.bottom - box.top)))


def _edge(gray: Gray, box: Patch, *, lower: bool, min_drop: float = MIN_DROP) -> _Edge | None:
    """Return the upper or lower edge, or None if too few columns show one."""
    inset = max(1, (box.right - box.left) // 16)
    columns = slice(box.left + inset, box.right - inset)
    at, reach = box.bottom if lower else box.top, _reach(box)
    first, last = max(at - reach - 1, 0), min(at + reach + 1, gray.shape[0])
    steps = np.diff(gray[first:last, columns].astype(np.float64), axis=0)
    drops = np.maximum(steps if lower else -steps, 0.0)
    if drops.size == 0:
        return None
    visible = drops.sum(axis=0) >= min_drop
    if visible.sum() < max(_MIN_COLUMNS, _MIN_VISIBLE * len(visible)):
        return None
    drops = drops[:, visible] ** 2  # squared, to weigh noise down
    rows = ((first + 0.5 + np.arange(len(drops))) @ drops) / drops.sum(axis=0)
    return _Edge(np.arange(columns.start, columns.stop, dtype=np.float64)[visible], rows)


def _line(x: Floats, y: Floats) -> tuple[float, float, float]:
    """Fit a line y = a + b x to points with outliers; return a, b and the median residual."""
    weight = np.ones_like(x)
    a = b = 0.0
    for _ in range(_ROUNDS):
        total = weight.sum()
        mean_x, mean_y = (weight @ x) / total, (weight @ y) / total
        spread = weight @ (x - mean_x) ** 2
        b = float(weight @ ((x - mean_x) * (y - mean_y)) / spread) if spread > 0.0 else 0.0
        a = float(mean_y - b * mean_x)
        residuals = np.abs(y - a - b * x)
        weight = 1.0 / (1.0 + (residuals / _SOFT_RESIDUAL) ** 2)
    return a, b, float(np.median(residuals))


def _side(gray: Gray, box: Patch, *, right: bool, min_drop: float = MIN_DROP) -> float | None:
    """Return the column of the left or right edge, or None if none is visible."""
    inset = max(1, (box.bottom - box.top) // 6)
    at, reach = box.right if right else box.left, _reach(box)
    first, last = max(at - reach - 1, 0), min(at + reach + 1, gray.shape[1])
    rows = gray[box.top + inset : box.bottom - inset, first:last].astype(np.float64)
    if min(rows.shape) < 2:
        return None
    steps = np.diff(np.median(rows, axis=0))
    drops = np.maximum(steps if right else -steps, 0.0)
    if float(drops.sum()) < min_drop:
        return None
    drops *= drops
    return float(drops @ (first + 0.5 + np.arange(len(drops)))) / float(drops.sum())


# --- lines --------------------------------------------------------------------------------------------
#
# Candidates for lines of white characters on a plate in an image.
#
# A plate in front of or beside something dark, as on a wall of glass bricks, is not a separate dark patch.
# Its characters are still bright patches of equal height on the horizon, side by side. Their height gives
# that of the plate, and their center is the plate's center.

LINE_LEVELS = 8
"""Number of thresholds, between the darkest and the brightest gray of the image."""

MIN_CHARACTER_HEIGHT = 5
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
    for level in np.linspace(darkest, brightest, LINE_LEVELS + 2)[1:-1].tolist():
        bright = (gray > level).view(np.uint8)
        stats = cv2.connectedComponentsWithStats(bright, connectivity=4, ltype=cv2.CV_16U)[2][1:]
        found += _lines(stats[_are_characters(stats, gray.shape[0], horizon)], gray.shape[1])
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


def _are_characters(stats: NDArray[np.int32], rows: int, horizon: float) -> NDArray[np.bool_]:
    """Return a mask of the components, (n, 5) as from OpenCV, that may be characters, single or merged."""
    _, top, width, height, _ = stats.T
    offset = np.abs(top + (height - 1) / 2.0 - horizon)
    likely = (
        (height >= MIN_CHARACTER_HEIGHT) & (width >= _MIN_ASPECT * height) & (width <= _MAX_ASPECT * height)
    )
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


# --- candidates ---------------------------------------------------------------------------------------
#
# Candidates for plates in an image: dark patches on the horizon with about the shape of a plate.
#
# A level camera at the height of the plates' centers sees each plate symmetrically about its horizon, at any
# distance and angle. This rules out most dark patches. Patches are dark below one of several thresholds, as
# no single one suits both a dim corridor and a sunlit wall: a plate is dark at many of them.

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
            for box in stats[1:][_are_plates(stats[1:], gray.shape[1], gray.shape[0], horizon)].tolist():
                left, top, width, height, _ = box
                found.append(Patch(left, top, left + width, top + height))
    return merge_patches(found)


def _are_plates(stats: NDArray[np.int32], columns: int, rows: int, horizon: float) -> NDArray[np.bool_]:
    """Return a mask of the components, (n, 5) as from OpenCV, with about a plate's shape and position."""
    left, top, width, height, area = stats.T
    offset = np.abs(top + (height - 1) / 2.0 - horizon)
    likely = (height >= MIN_HEIGHT) & (width >= MIN_ASPECT * height) & (width <= MAX_ASPECT * height)
    likely &= (left > 0) & (top > 0) & (left + width < columns) & (top + height < rows)
    likely &= (offset <= 1.5 + 0.08 * height) & (area >= _MIN_FILL * width * height)
    return np.asarray(likely, dtype=np.bool_)
