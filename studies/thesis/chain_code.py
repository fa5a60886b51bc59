"""Borders of regions as chain codes, and the corners of such a curve (thesis section 5.7).

A chain code lists the steps of a border: 0 is to the right, 2 up, 4 to the left, 6 down, odd numbers are the
diagonals between. Source of the corners: Beus and Tiu, An Improved Corner Detection Algorithm Based on
Chain-Coded Plane Curves (1987), which is that of Freeman and Davis (1977) with the arms of a corner limited
in length, averaged over several lengths of the segments whose turning is watched.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SEGMENTS = (3, 4, 5)
"""Numbers of steps over which directions are measured; cornerness is averaged over them."""

LONGEST_ARM = 10
"""Maximum number of straight steps that count on either side of a corner."""

MIN_CORNERNESS = 8.0
"""Minimum cornerness of a corner, in radians times steps: a right angle with arms of three steps has 9.4."""

_STEPS = ((1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1))  # column, row
_DX, _DY = (np.array(axis, dtype=np.float64) for axis in zip(*_STEPS, strict=True))


class Border(NamedTuple):
    """A closed border: its pixels, (n, 2) of column and row, and the step from each to the next one, (n,)."""

    pixels: NDArray[np.int64]
    codes: NDArray[np.int64]


def trace_border(binary: NDArray[np.bool_], column: int, row: int) -> Border | None:
    """Trace the border of a bright region, clockwise from a pixel with a dark one on its left.

    None if the border is not closed within the image, or is a single pixel.
    """
    rows, columns = binary.shape
    bright = binary.tolist()
    x, y, back = column, row, 4  # `back`: direction from the pixel to the dark one
    pixels: list[tuple[int, int]] = []
    codes: list[int] = []
    while True:
        if not (0 < x < columns - 1 and 0 < y < rows - 1):
            return None
        for turn in range(1, 9):
            code = (back - turn) % 8  # clockwise, as rows grow downward
            dx, dy = _STEPS[code]
            if bright[y + dy][x + dx]:
                break
        else:
            return None
        if pixels and (x, y) == (column, row) and code == codes[0]:
            return Border(np.array(pixels), np.array(codes))
        pixels.append((x, y))
        codes.append(code)
        x, y = x + dx, y + dy
        # Direction from the new pixel to the last dark neighbor.
        back = (code + 3) % 8 if code % 2 else (code + 2) % 8


def cornerness(codes: NDArray[np.int64], *, longest_arm: int = LONGEST_ARM) -> Floats:
    """Return the cornerness of each pixel of a closed border, (n,).

    It is the turn of the border there, in radians, positive to the right, times the geometric mean of the
    lengths of its two arms.
    """
    total = np.zeros(len(codes))
    for segment in SEGMENTS:
        if segment < len(codes):
            total += _cornerness(codes, segment, longest_arm)
    return total / len(SEGMENTS)


def corners(border: Border) -> NDArray[np.int64]:
    """Return the corners at which a closed border turns to the right, (n, 2) of column and row, in order."""
    value = cornerness(border.codes)
    apart = max(SEGMENTS)
    count = len(value)
    if count <= 2 * apart:
        return np.zeros((0, 2), dtype=np.int64)
    around = np.stack([np.roll(value, shift) for shift in range(-apart, apart + 1) if shift])
    before = np.stack([np.roll(value, shift) for shift in range(1, apart + 1)])
    peak = (value >= around.max(axis=0)) & (value > before.max(axis=0)) & (value >= MIN_CORNERNESS)
    found: NDArray[np.int64] = border.pixels[peak]
    return found


def _cornerness(codes: NDArray[np.int64], segment: int, longest_arm: int) -> Floats:
    """Return the cornerness for one segment length; segment j is the `segment` steps ending with step j."""
    x, y = _windows(_DX[codes], segment), _windows(_DY[codes], segment)
    angle = np.arctan2(y, x)
    turn = np.roll(angle, -1) - np.roll(angle, 1)
    turn = (turn + math.pi) % (2.0 * math.pi) - math.pi
    straight = np.abs(turn) <= math.atan(1.0 / (segment - 1)) + 1e-9
    # The sum from j - segment to j is the turn at the pixel after step j - segment.
    turned = _windows(turn, segment + 1)
    before = _run(straight, longest_arm)  # up to and including j
    after = _run(straight[::-1], longest_arm)[::-1]  # from j on
    at = np.roll(turned, -segment)
    arms = np.sqrt(np.roll(before, 1) * np.roll(after, -segment - 1))
    # `at[j]` is the turn at the end of step j, that is, at the pixel after pixel j.
    return np.asarray(np.roll(at * arms, 1))


def _windows(values: Floats, length: int) -> Floats:
    """Return, for each value of a closed curve, the sum of the last `length` values up to it."""
    sums = np.cumsum(np.concatenate([values[len(values) - length + 1 :], values]))
    return np.asarray(sums[length - 1 :] - np.concatenate([[0.0], sums[: len(values) - 1]]))


def _run(straight: NDArray[np.bool_], longest: int) -> Floats:
    """Return the number of successive straight steps up to and including each step, at most `longest`."""
    runs = np.zeros(len(straight))
    alive = np.ones(len(straight), dtype=np.bool_)
    for shift in range(longest):
        alive &= np.roll(straight, shift)
        runs += alive
    return runs
