"""Landmark observations of the robot's pose: linear in x, y and the heading.

A ceiling light gives the place along its corridor; a plate that is known from the map gives the same, and the
distance to the wall; lines on the ceiling, or a wall, give the heading. Each is a row: the coefficients of x
and y (in mm) and of the heading (in radians), their sum, and its standard deviation. Rows hold for the pose
at the time of the image, `t_ns`.

Headings may be counted from any turn: whether one is 359 degrees or -1, `value` is right for both, since the
filter looks for the turn that fits best. A row of both the place and the heading needs a heading that counts:
a turn of it has to make more than the place may be off, or the row is rejected.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple


class Row(NamedTuple):
    """cx * x + cy * y + ch * heading = value, give or take `sigma`; mm and radians."""

    cx: float
    cy: float
    ch: float
    value: float
    sigma: float


class Fix(NamedTuple):
    """Observations of one moment, independent of each other."""

    t_ns: int
    rows: tuple[Row, ...]


def fix_list(fix: Fix) -> list[float]:
    """Return a fix as DServer keeps it: the time, then five numbers a row."""
    return [fix.t_ns, *(number for row in fix.rows for number in row)]


def fix_of(told: Any) -> Fix | None:
    """Return the fix in a value of DServer; None if it is no list, cut short, or not all finite."""
    if not isinstance(told, list | tuple) or len(told) % 5 != 1:
        return None
    if not all(isinstance(number, int | float) and math.isfinite(number) for number in told):
        return None
    numbers = tuple(float(number) for number in told[1:])
    rows = tuple(Row(*numbers[i : i + 5]) for i in range(0, len(numbers), 5))
    return Fix(int(told[0]), rows)
