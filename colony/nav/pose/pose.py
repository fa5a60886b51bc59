"""The estimate of a robot's pose and its uncertainty, as the pose estimator publishes it at DServer."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from typing import Any, NamedTuple


class PoseEstimate(NamedTuple):
    """A pose in the map of the current floor, with its covariance.

    `x_mm` is east and `y_mm` north, the heading counterclockwise from north. `xx` to `hh` are the upper
    triangle of the covariance, row by row: mm^2, mm^2, mm deg, mm^2, mm deg, deg^2. The pose is that at
    `t_ns`, in the robot's time.
    """

    t_ns: int
    x_mm: float
    y_mm: float
    heading_deg: float
    xx: float
    xy: float
    xh: float
    yy: float
    yh: float
    hh: float

    def sigma_along(self, east: float, north: float) -> float:
        """Return the standard deviation of the position along a unit vector, in mm."""
        variance = self.xx * east * east + 2.0 * self.xy * east * north + self.yy * north * north
        return math.sqrt(max(variance, 0.0))

    @property
    def sigma_deg(self) -> float:
        """The standard deviation of the heading."""
        return math.sqrt(max(self.hh, 0.0))


def pose_list(pose: PoseEstimate) -> list[float]:
    """Encode a pose for DServer: ten numbers, in the order of `PoseEstimate`."""
    return list(pose)


def pose_of(value: Any) -> PoseEstimate | None:
    """Decode a pose from DServer; None if the value is not a list of ten finite numbers."""
    if not isinstance(value, list | tuple) or len(value) != len(PoseEstimate._fields):
        return None
    if not all(isinstance(number, int | float) and math.isfinite(number) for number in value):
        return None
    return PoseEstimate(int(value[0]), *map(float, value[1:]))


# --- fixes --------------------------------------------------------------------------------------------
#
# Fixes: measurements of the robot's pose by landmarks, linear in x, y and the heading.
#
# A ceiling light measures the position along its corridor. A plate of the map also measures the distance to
# the wall. The edges of a light, or a wall, measure the heading. Each measurement is a row: the coefficients
# of x and y (in mm) and of the heading (in radians), the measured sum, and its standard deviation. Rows hold
# for the pose at the time of the image, `t_ns`.
#
# Headings are measured modulo a full turn: 359 and -1 degrees are the same `value`, as the filter chooses the
# turn that fits best. In a row of both position and heading, a full turn of the heading must change the sum
# by more than any position error could; otherwise the row is rejected.


class MeasurementRow(NamedTuple):
    """The measurement cx * x + cy * y + ch * heading = value, with its standard deviation; mm and radians."""

    cx: float
    cy: float
    ch: float
    value: float
    sigma: float


class Fix(NamedTuple):
    """Independent measurements of the pose at one time."""

    t_ns: int
    rows: tuple[MeasurementRow, ...]


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
    rows = tuple(MeasurementRow(*numbers[i : i + 5]) for i in range(0, len(numbers), 5))
    return Fix(int(value[0]), rows)


# --- steps --------------------------------------------------------------------------------------------
#
# Motion of the robot by its odometry: in one step, and since a past time.


class OdometryStep(NamedTuple):
    """A motion of the robot in its frame at the start.

    Distances ahead and to the left in mm, and the turn in radians counterclockwise.
    """

    ahead_mm: float
    left_mm: float
    turned_rad: float


class MotionSince(NamedTuple):
    """The motion of the robot since a past time, in its current frame.

    Distances ahead and to the left in mm, the turn in radians counterclockwise, and the distance traveled in
    mm.
    """

    ahead_mm: float
    left_mm: float
    turned_rad: float
    travel_mm: float


NO_MOTION = MotionSince(0.0, 0.0, 0.0, 0.0)


# --- motion history -----------------------------------------------------------------------------------
#
# The robot's recent motion by its odometry, which relates a past observation to the current pose.

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

    def add(self, t_ns: int, step: OdometryStep) -> None:
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
