"""The estimate of a robot's pose and its uncertainty, as the pose estimator publishes it at DServer."""

from __future__ import annotations

import math
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
