"""The robot's recent motion by its odometry, which relates a past observation to the current pose."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from typing import NamedTuple

from colony.nav.pose.steps import NO_MOTION, MotionSince, Step

MAX_AGE_NS = 5_000_000_000
"""Maximum age of remembered motion; older observations cannot be used."""


class _TimedPose(NamedTuple):
    """A pose of the robot in the frame of the history's start.

    x, y in mm, the heading in radians, not wrapped, and the distance traveled so far.
    """

    t_ns: int
    x_mm: float
    y_mm: float
    heading_rad: float
    travel_mm: float


class MotionHistory:
    """The motion of the last seconds. Mutable."""

    def __init__(self) -> None:
        self._poses: deque[_TimedPose] = deque()

    def restart(self, t_ns: int) -> None:
        """Discard the history: the motion before `t_ns` is unknown."""
        self._poses.clear()
        self._poses.append(_TimedPose(t_ns, 0.0, 0.0, 0.0, 0.0))

    def add(self, t_ns: int, step: Step) -> None:
        """Record a step of the robot that ends at `t_ns`."""
        last = self._poses[-1]
        sine, cosine = math.sin(last.heading_rad), math.cos(last.heading_rad)
        pose = _TimedPose(
            max(t_ns, last.t_ns),
            last.x_mm - step.ahead_mm * sine - step.left_mm * cosine,
            last.y_mm + step.ahead_mm * cosine - step.left_mm * sine,
            last.heading_rad + step.turned_rad,
            last.travel_mm + math.hypot(step.ahead_mm, step.left_mm),
        )
        self._poses.append(pose)
        while self._poses[0].t_ns < t_ns - MAX_AGE_NS:
            self._poses.popleft()

    @property
    def t_ns(self) -> int:
        """End time of the newest step."""
        return self._poses[-1].t_ns

    def motion_since(self, t_ns: int) -> MotionSince | None:
        """Return the motion since a time, or None for a time before the history's start."""
        poses, newest = self._poses, self._poses[-1]
        if t_ns >= newest.t_ns:
            return NO_MOTION
        after = bisect_left(poses, t_ns, key=lambda pose: pose.t_ns)
        if after == 0 and poses[0].t_ns != t_ns:
            return None
        past = poses[after] if after == 0 else _between(poses[after - 1], poses[after], t_ns)
        x, y = newest.x_mm - past.x_mm, newest.y_mm - past.y_mm
        sine, cosine = math.sin(newest.heading_rad), math.cos(newest.heading_rad)
        return MotionSince(
            ahead_mm=-x * sine + y * cosine,
            left_mm=-x * cosine - y * sine,
            turned_rad=newest.heading_rad - past.heading_rad,
            travel_mm=newest.travel_mm - past.travel_mm,
        )


def _between(a: _TimedPose, b: _TimedPose, t_ns: int) -> _TimedPose:
    """Interpolate linearly between two poses."""
    fraction = (t_ns - a.t_ns) / (b.t_ns - a.t_ns)
    x, y, heading, travel = (p + fraction * (q - p) for p, q in zip(a[1:], b[1:], strict=True))
    return _TimedPose(t_ns, x, y, heading, travel)
