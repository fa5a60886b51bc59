"""What a landmark tells about the robot's pose: linear observations of x, y and the heading.

A ceiling light tells the place along its corridor; a plate that is known from the map the same, and how far
the wall is; lines on the ceiling, or a wall, the heading. Each is a row: the coefficients of x and y (in mm)
and of the heading (in radians), what they add up to, and the standard deviation of that. Rows hold for the
pose at the time of the image, `t_ns`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple


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
    """A fix as DServer keeps it: the time, then five numbers a row."""
    return [fix.t_ns, *(number for row in fix.rows for number in row)]


def fix_of(told: Sequence[float]) -> Fix | None:
    """The fix in such a list; None where it is none: empty, or cut short."""
    if len(told) < 1 or len(told) % 5 != 1:
        return None
    numbers = tuple(float(number) for number in told[1:])
    rows = tuple(Row(*numbers[i : i + 5]) for i in range(0, len(numbers), 5))
    return Fix(int(told[0]), rows)
