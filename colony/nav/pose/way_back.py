"""The robot's recent motion by its odometry, so that an observation of a past moment can be used now."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from typing import NamedTuple

from colony.nav.pose.steps import NOW, Since, Step

KEPT_NS = 5_000_000_000
"""Age beyond which an observation is of no use."""


class _Place(NamedTuple):
    """A place of the robot relative to the beginning of its way.

    x, y in mm, its heading in radians, counted on beyond a turn, and the length of the way until then.
    """

    t_ns: int
    x_mm: float
    y_mm: float
    heading_rad: float
    way_mm: float


class WayBack:
    """The last seconds of a way. Mutable: its places, oldest first."""

    def __init__(self) -> None:
        self._places: deque[_Place] = deque()

    def begin(self, t_ns: int) -> None:
        """Forget all: the robot is somewhere now, and nothing is known of how it came there."""
        self._places.clear()
        self._places.append(_Place(t_ns, 0.0, 0.0, 0.0, 0.0))

    def go(self, t_ns: int, step: Step) -> None:
        """Record a step of the robot that ends at `t_ns`."""
        last = self._places[-1]
        sine, cosine = math.sin(last.heading_rad), math.cos(last.heading_rad)
        place = _Place(
            max(t_ns, last.t_ns),
            last.x_mm - step.ahead_mm * sine - step.left_mm * cosine,
            last.y_mm + step.ahead_mm * cosine - step.left_mm * sine,
            last.heading_rad + step.turned_rad,
            last.way_mm + math.hypot(step.ahead_mm, step.left_mm),
        )
        self._places.append(place)
        while self._places[0].t_ns < t_ns - KEPT_NS:
            self._places.popleft()

    @property
    def t_ns(self) -> int:
        """End of the newest step."""
        return self._places[-1].t_ns

    def since(self, t_ns: int) -> Since | None:
        """Return the motion since a moment, or None if the moment is before all that is known."""
        places, now = self._places, self._places[-1]
        if t_ns >= now.t_ns:
            return NOW
        after = bisect_left(places, t_ns, key=lambda place: place.t_ns)
        if after == 0 and places[0].t_ns != t_ns:
            return None
        then = places[after] if after == 0 else _between(places[after - 1], places[after], t_ns)
        x, y = now.x_mm - then.x_mm, now.y_mm - then.y_mm
        sine, cosine = math.sin(now.heading_rad), math.cos(now.heading_rad)
        return Since(
            ahead_mm=-x * sine + y * cosine,
            left_mm=-x * cosine - y * sine,
            turned_rad=now.heading_rad - then.heading_rad,
            way_mm=now.way_mm - then.way_mm,
        )


def _between(a: _Place, b: _Place, t_ns: int) -> _Place:
    """Return the robot's place between two others, if it went straight from one to the other."""
    part = (t_ns - a.t_ns) / (b.t_ns - a.t_ns)
    x, y, heading, way = (p + part * (q - p) for p, q in zip(a[1:], b[1:], strict=True))
    return _Place(t_ns, x, y, heading, way)
