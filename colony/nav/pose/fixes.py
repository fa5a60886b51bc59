"""Fixes: measurements of the robot's pose by landmarks, linear in x, y and the heading.

A ceiling light measures the position along its corridor. A plate of the map also measures the distance to
the wall. The edges of a light, or a wall, measure the heading. Each measurement is a row: the coefficients of
x and y (in mm) and of the heading (in radians), the measured sum, and its standard deviation. Rows hold for
the pose at the time of the image, `t_ns`.

Headings are measured modulo a full turn: 359 and -1 degrees are the same `value`, as the filter chooses
the turn that fits best. In a row of both position and heading, a full turn of the heading must change the sum
by more than any position error could; otherwise the row is rejected.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple


class Row(NamedTuple):
    """The measurement cx * x + cy * y + ch * heading = value, with its standard deviation; mm and radians."""

    cx: float
    cy: float
    ch: float
    value: float
    sigma: float


class Fix(NamedTuple):
    """Independent measurements of the pose at one time."""

    t_ns: int
    rows: tuple[Row, ...]


def fix_list(fix: Fix) -> list[float]:
    """Encode a fix for DServer: the time, then five numbers per row."""
    return [fix.t_ns, *(number for row in fix.rows for number in row)]


def fix_of(value: Any) -> Fix | None:
    """Decode a fix from DServer; None if the value is not a list of finite numbers of the right length."""
    if not isinstance(value, list | tuple) or len(value) % 5 != 1:
        return None
    if not all(isinstance(number, int | float) and math.isfinite(number) for number in value):
        return None
    numbers = tuple(float(number) for number in value[1:])
    rows = tuple(Row(*numbers[i : i + 5]) for i in range(0, len(numbers), 5))
    return Fix(int(value[0]), rows)
