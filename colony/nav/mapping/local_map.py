"""Local sonar maps, with their origin at the robot's initial or current position."""

from __future__ import annotations

import math
from collections import deque

from colony.nav.mapping.himm import HimmMap, HimmParameters, LocalPose
from colony.nav.mapping.hough import HoughParameters, Line, lines_in
from colony.nav.pose.echoes import Floats
from colony.nav.pose.steps import Step


def pose_after(pose: LocalPose, step: Step) -> LocalPose:
    """Return the pose of a robot after a step."""
    sine, cosine = math.sin(pose.heading_rad), math.cos(pose.heading_rad)
    return LocalPose(
        ahead_mm=pose.ahead_mm + step.ahead_mm * cosine - step.left_mm * sine,
        left_mm=pose.left_mm + step.ahead_mm * sine + step.left_mm * cosine,
        heading_rad=pose.heading_rad + step.turned_rad,
    )


def relative_pose(origin: LocalPose, pose: LocalPose) -> LocalPose:
    """Return `pose` in the frame of `origin`, both poses in the same local map."""
    sine, cosine = math.sin(origin.heading_rad), math.cos(origin.heading_rad)
    ahead, left = pose.ahead_mm - origin.ahead_mm, pose.left_mm - origin.left_mm
    return LocalPose(
        ahead_mm=ahead * cosine + left * sine,
        left_mm=left * cosine - ahead * sine,
        heading_rad=pose.heading_rad - origin.heading_rad,
    )


_SPACING_MM, _SPACING_RAD = 60.0, math.radians(3.0)
"""Minimum distance or turn between two recorded scans."""


class Trail:
    """The scans of the last few meters, located by odometry alone. Mutable.

    On demand, a map around the robot's current position is built from them.
    """

    def __init__(self, length_mm: float) -> None:
        """Keep the scans of the last `length_mm` traveled."""
        self._length_mm = length_mm
        self._scans: deque[tuple[float, LocalPose, Floats]] = deque()
        self._pose = LocalPose(0.0, 0.0, 0.0)
        self._travel_mm = 0.0

    @property
    def travel_mm(self) -> float:
        """Distance traveled since the oldest scan, in mm."""
        return self._travel_mm - self._scans[0][0] if self._scans else 0.0

    def clear(self) -> None:
        """Discard all scans."""
        self._scans.clear()

    def add(self, step: Step, ranges: Floats | None) -> None:
        """Record a step of the robot, and a scan after it, if there is one."""
        self._pose = pose_after(self._pose, step)
        self._travel_mm += math.hypot(step.ahead_mm, step.left_mm)
        if ranges is None:
            return
        if self._scans:
            travel_mm, last, _ = self._scans[-1]
            turned = abs(self._pose.heading_rad - last.heading_rad)
            if self._travel_mm - travel_mm < _SPACING_MM and turned < _SPACING_RAD:
                return
        self._scans.append((self._travel_mm, self._pose, ranges))
        while self._travel_mm - self._scans[0][0] > self._length_mm:
            self._scans.popleft()

    def lines(self, himm: HimmParameters, hough: HoughParameters | None = None) -> tuple[Line, ...]:
        """Return the lines in a map of these scans, with its origin at the robot's current position."""
        local_map = HimmMap(himm)
        for _, pose, ranges in self._scans:
            local_map.mark(relative_pose(self._pose, pose), ranges)
        return lines_in(local_map.cells(), hough)
