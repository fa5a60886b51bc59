"""LaserScan and Range as readings: bearings of the interface, and values by REP 117.

REP 117 says what a range means: +inf that nothing was there, -inf that something is too near to be measured,
NaN that the measurement failed. What is below or above the range of the device is discarded. Here, +inf is no
echo, too near is 0 m, and all else without a distance is invalid.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

TURN = math.tau

MAX_TURNS = 2.0
"""Maximum number of turns that a scan may take; one of more is damaged."""

SLACK_RAD = 1e-5
"""Slack in radians at the ends of a scan, whose angles are rounded to 32 bits."""

TOO_NEAR_M = 0.0
"""Distance in m that stands for an object too near to be measured."""

_LEAST = 5e-324
"""Least number above 0."""


class UnusableError(ValueError):
    """A message that cannot be a reading, with the reason."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mounting:
    """The mounting of a scanner on the robot.

    Attributes:
        bearing_rad: the bearing at which its angle 0 looks, counterclockwise from ahead.
        is_upside_down: True if its angles grow clockwise, seen from above.
        is_zero_no_echo: True if it sends 0 for a beam without an echo.
    """

    bearing_rad: float = 0.0
    is_upside_down: bool = False
    is_zero_no_echo: bool = False


def distance(value: float, low: float, high: float, *, is_zero_no_echo: bool = False) -> float | None:
    """Return a range in m by REP 117: infinite for no echo, None if it is invalid.

    Args:
        value: the range as sent.
        low: the least range that the device measures.
        high: the greatest one.
        is_zero_no_echo: True if 0 stands for no echo.
    """
    if value == math.inf or (value == 0.0 and is_zero_no_echo):
        return math.inf
    if value == -math.inf:
        return TOO_NEAR_M
    return value if max(low, 0.0) <= value <= high else None


class ScanReader:
    """Reads scans as arrays of the interface. Mutable: keeps which beam each element takes.

    Args:
        bearings_rad: the bearing of each element, counterclockwise from ahead.
        spacing_rad: the angle between two elements: half of it is how far a single beam counts.
        mounting: how the scanner is mounted.
    """

    def __init__(self, bearings_rad: Sequence[float], spacing_rad: float, mounting: Mounting) -> None:
        self._bearings = tuple(bearings_rad)
        self._spacing = spacing_rad
        self._mounting = mounting
        self._key: tuple[float, float, int] | None = None
        self._beams: tuple[int | None, ...] = ()

    def read(self, scan: Mapping[str, Any]) -> tuple[float | None, ...]:
        """Return the elements in m; infinite for one without an echo, None for one that is invalid.

        An element beyond the ends of the scan is invalid.

        Raises:
            UnusableError: the angles of the scan or its limits are none.
        """
        ranges: Sequence[float] = scan["ranges"]
        low, high = scan["range_min"], scan["range_max"]
        if not low < high:
            raise UnusableError(f"ranges from {low:g} to {high:g} m")
        key = (scan["angle_min"], scan["angle_increment"], len(ranges))
        if key != self._key:
            self._beams, self._key = self._taken(*key), key
        is_zero = self._mounting.is_zero_no_echo
        least = max(low, _LEAST if is_zero else 0.0)
        return tuple(
            [
                None
                if i is None
                else value
                if least <= (value := ranges[i]) <= high
                else distance(value, low, high, is_zero_no_echo=is_zero)
                for i in self._beams
            ]
        )

    def _taken(self, first: float, step: float, count: int) -> tuple[int | None, ...]:
        """Return the beam that each element takes; None if no beam is near enough."""
        if not math.isfinite(first) or not math.isfinite(step):
            raise UnusableError(f"angles from {first:g} by {step:g} rad")
        if count > 1 and step == 0.0:
            raise UnusableError(f"{count} beams, and an `angle_increment` of 0")
        if (count - 1) * abs(step) > MAX_TURNS * TURN:
            raise UnusableError(f"{count} beams of {step:g} rad, which take more than {MAX_TURNS:g} turns")
        sign = -1.0 if self._mounting.is_upside_down else 1.0
        start = self._mounting.bearing_rad + sign * first
        step = sign * step or self._spacing  # of a single beam
        return tuple([_nearest(bearing - start, step, count) for bearing in self._bearings])


def _nearest(offset: float, step: float, count: int) -> int | None:
    """Return the beam nearest to an angle, counted from beam 0, within half a step; of two the lower one."""
    if step < 0.0:
        offset, step = -offset, -step
    turned = offset % TURN
    best: tuple[float, int] | None = None
    for angle in (turned - TURN, turned, turned + TURN) if count else ():
        beam = min(max(math.ceil(angle / step - 0.5), 0), count - 1)
        away = abs(angle - beam * step)
        if away <= step / 2.0 + SLACK_RAD and (best is None or away < best[0]):
            best = (away, beam)
    return None if best is None else best[1]
