"""The outline of a dark patch as four lines, with subpixel accuracy.

The camera is level and walls are upright, so the left and the right edge are upright in the image, and the
upper and the lower one any straight lines. An edge is where the image gets darker toward the inside: at the
centroid of the gray-level steps from row to row or from column to column.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.vision.detections import Corner
from colony.vision.gray_images import Gray
from colony.vision.plates.patches import Patch

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
