"""Dead reckoning from registers that wrap around: differences, plausible steps, arcs. No I/O, no clock."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from colony.drivers.dialect import ImplausibleError

SLACK_S = 0.25
"""Seconds that are added to the time between two packets, because packets arrive late in bursts."""

RESTARTS_AFTER = 5
"""Number of implausible steps in a row after which the device has restarted its registers."""


def wrapped_difference(new: int, old: int, bits: int) -> int:
    """Return the step from `old` to `new` of a register of `bits` bits, the shorter way around.

    Bits above `bits` are ignored, so that signed and unsigned readings of one register are the same.

    Example:
        >>> wrapped_difference(3, 65534, 16), wrapped_difference(65534, 3, 16)
        (5, -5)
    """
    half = 1 << (bits - 1)
    return ((new - old + half) & ((1 << bits) - 1)) - half


@dataclass(frozen=True, slots=True)
class OdometryPose:
    """A pose of dead reckoning: mm (x east, y north), and degrees (0 north, counterclockwise)."""

    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0


def along_arc(pose: OdometryPose, distance: float, turned: float) -> OdometryPose:
    """Return the pose after driving `distance` mm along an arc that turns by `turned` degrees."""
    half = math.radians(turned) / 2.0
    chord = distance * (math.sin(half) / half if half else 1.0)
    direction = math.radians(pose.heading) + half
    return OdometryPose(
        pose.x - chord * math.sin(direction),
        pose.y + chord * math.cos(direction),
        (pose.heading + turned) % 360.0,
    )


class Registers:
    """Registers that count and wrap, such as encoders. Mutable: keeps their last values and time.

    A step that is faster than the device can count is implausible: a damaged packet whose checksum holds. The
    next one counts from the values before it. After `RESTARTS_AFTER` such steps in a row the device has
    restarted, and counting begins again from its new values.

    Args:
        bits: number of bits of each register.
        max_rate: greatest rate of all registers, in counts a second.
    """

    def __init__(self, *bits: int, max_rate: float) -> None:
        self._bits = bits
        self._max_rate = max_rate
        self._last: tuple[tuple[int, ...], int] | None = None
        self._refused = 0

    def restart(self) -> None:
        """Count from the next values on."""
        self._last = None

    def step(self, values: Sequence[int], t_ns: int) -> tuple[tuple[int, ...], float]:
        """Return the steps of the registers since the last call, and the seconds that they took.

        Both are 0 in the first call.

        Raises:
            ImplausibleError: the device cannot count as fast.
        """
        read = tuple(values)
        if self._last is None:
            self._last, self._refused = (read, t_ns), 0
            return (0,) * len(read), 0.0
        last, last_ns = self._last
        steps = tuple(map(wrapped_difference, read, last, self._bits))
        elapsed_s = max(0, t_ns - last_ns) / 1e9
        if max(map(abs, steps)) > self._max_rate * (elapsed_s + SLACK_S):
            self._refused += 1
            if self._refused >= RESTARTS_AFTER:
                self._last, self._refused = (read, t_ns), 0
            raise ImplausibleError(f"registers {last} became {read} within {elapsed_s:.3f} s")
        self._last, self._refused = (read, t_ns), 0
        return steps, elapsed_s
