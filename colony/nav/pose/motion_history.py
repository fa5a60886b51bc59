"""The robot's recent motion by its odometry, which relates a past observation to the present pose."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from typing import NamedTuple

from colony.nav.pose.steps import NO_MOTION, MotionSince, Step

MAX_AGE_NS = 5_000_000_000
"""Age up to which motion is remembered; older observations cannot be used."""


class _Place(NamedTuple):
    """A pose of the robot in the frame of the history's start.

    x, y in mm, the heading in radians, not wrapped, and the distance traveled so far.
    """

    t_ns: int
    x_mm: float
    y_mm: float
    heading_rad: float
    travel_mm: float


class MotionHistory:
    """The motion of the last seconds. Mutable: its places, oldest first."""

    def __init__(self) -> None:
        self._places: deque[_Place] = deque()

    def restart(self, t_ns: int) -> None:
        """Discard the history: the motion before `t_ns` is unknown."""
        self._places.clear()
        self._places.append(_Place(t_ns, 0.0, 0.0, 0.0, 0.0))

    def add(self, t_ns: int, step: Step) -> None:
        """Record a step of the robot that ends at `t_ns`."""
        last = self._places[-1]
        sine, cosine = math.sin(last.heading_rad), math.cos(last.heading_rad)
        place = _Place(
            max(t_ns, last.t_ns),
            last.x_mm - step.ahead_mm * sine - step.left_mm * cosine,
            last.y_mm + step.ahead_mm * cosine - step.left_mm * sine,
            last.heading_rad + step.turned_rad,
            last.travel_mm + math.hypot(step.ahead_mm, step.left_mm),
        )
        self._places.append(place)
        while self._places[0].t_ns < t_ns - MAX_AGE_NS:
            self._places.popleft()

    @property
    def t_ns(self) -> int:
        """End of the newest step."""
        return self._places[-1].t_ns

    def motion_since(self, t_ns: int) -> MotionSince | None:
        """Return the motion since a time, or None for a time before the history's start."""
        places, now = self._places, self._places[-1]
        if t_ns >= now.t_ns:
            return NO_MOTION
        after = bisect_left(places, t_ns, key=lambda place: place.t_ns)
        if after == 0 and places[0].t_ns != t_ns:
            return None
        then = places[after] if after == 0 else _between(places[after - 1], places[after], t_ns)
        x, y = now.x_mm - then.x_mm, now.y_mm - then.y_mm
        sine, cosine = math.sin(now.heading_rad), math.cos(now.heading_rad)
        return MotionSince(
            ahead_mm=-x * sine + y * cosine,
            left_mm=-x * cosine - y * sine,
            turned_rad=now.heading_rad - then.heading_rad,
            travel_mm=now.travel_mm - then.travel_mm,
        )


def _between(a: _Place, b: _Place, t_ns: int) -> _Place:
    """Interpolate the robot's place between two others, on a straight line."""
    part = (t_ns - a.t_ns) / (b.t_ns - a.t_ns)
    x, y, heading, way = (p + part * (q - p) for p, q in zip(a[1:], b[1:], strict=True))
    return _Place(t_ns, x, y, heading, way)
