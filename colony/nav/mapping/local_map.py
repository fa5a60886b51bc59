"""Local sonar maps around a robot: where the map began, or where the robot is now."""

from __future__ import annotations

import math
from collections import deque

from colony.nav.mapping.himm import HimmMap, HimmSetting, LocalPose
from colony.nav.mapping.hough import HoughSetting, Line, lines_in
from colony.nav.maps.stickrep.model import Pose
from colony.nav.pose.echoes import Floats
from colony.nav.pose.steps import Step


def local_pose(origin: Pose, pose: Pose) -> LocalPose:
    """Return a pose as seen from another one (thesis section 5.5)."""
    heading = math.radians(origin.heading_deg)
    sine, cosine = math.sin(heading), math.cos(heading)
    dx, dy = pose.x_mm - origin.x_mm, pose.y_mm - origin.y_mm
    return LocalPose(
        ahead_mm=-dx * sine + dy * cosine,
        left_mm=-dx * cosine - dy * sine,
        heading_rad=math.radians(pose.heading_deg) - heading,
    )


def beyond(pose: LocalPose, step: Step) -> LocalPose:
    """Return the pose of a robot after a step."""
    sine, cosine = math.sin(pose.heading_rad), math.cos(pose.heading_rad)
    return LocalPose(
        ahead_mm=pose.ahead_mm + step.ahead_mm * cosine - step.left_mm * sine,
        left_mm=pose.left_mm + step.ahead_mm * sine + step.left_mm * cosine,
        heading_rad=pose.heading_rad + step.turned_rad,
    )


def seen_from(origin: LocalPose, pose: LocalPose) -> LocalPose:
    """Return a pose of the same map as seen from another one of it."""
    sine, cosine = math.sin(origin.heading_rad), math.cos(origin.heading_rad)
    ahead, left = pose.ahead_mm - origin.ahead_mm, pose.left_mm - origin.left_mm
    return LocalPose(
        ahead_mm=ahead * cosine + left * sine,
        left_mm=left * cosine - ahead * sine,
        heading_rad=pose.heading_rad - origin.heading_rad,
    )


_SPACING_MM, _SPACING_RAD = 60.0, math.radians(3.0)
"""Way and turn from one scan of a trail to the next, at least one of them."""


class Trail:
    """The scans of the last few meters, by odometry alone. Mutable.

    A map is made of them only when one is wanted, around the place where the robot is then.
    """

    def __init__(self, length_mm: float) -> None:
        """Remember scans along so much of the way."""
        self._length_mm = length_mm
        self._scans: deque[tuple[float, LocalPose, Floats]] = deque()
        self._at = LocalPose(0.0, 0.0, 0.0)
        self._way_mm = 0.0

    @property
    def way_mm(self) -> float:
        """Distance that the robot traveled since the oldest scan, in mm."""
        return self._way_mm - self._scans[0][0] if self._scans else 0.0

    def clear(self) -> None:
        """Forget all scans."""
        self._scans.clear()

    def add(self, step: Step, ranges: Floats | None) -> None:
        """Record a step of the robot, and a scan after it, if there is one."""
        self._at = beyond(self._at, step)
        self._way_mm += math.hypot(step.ahead_mm, step.left_mm)
        if ranges is None:
            return
        if self._scans:
            way, last, _ = self._scans[-1]
            turned = abs(self._at.heading_rad - last.heading_rad)
            if self._way_mm - way < _SPACING_MM and turned < _SPACING_RAD:
                return
        self._scans.append((self._way_mm, self._at, ranges))
        while self._way_mm - self._scans[0][0] > self._length_mm:
            self._scans.popleft()

    def lines(self, himm: HimmSetting, hough: HoughSetting | None = None) -> tuple[Line, ...]:
        """Return the lines in a map of these scans whose origin is where the robot is now."""
        local = HimmMap(himm)
        for _, pose, ranges in self._scans:
            local.mark(seen_from(self._at, pose), ranges)
        return lines_in(local.cells(), hough)
