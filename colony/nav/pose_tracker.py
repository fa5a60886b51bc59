"""Follows a robot through the map of its floor, by odometry and sonar.

In the normal case the position filter does it all. Where it lost the way, because a wheel slipped, say,
headings around the believed one are tried on single scans; where that fails, a local map of the last meters
is made, and the lines in it are matched to the walls.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from colony.nav.echoes import Floats, Mirrors, Ring, SonarModel, mirrors_of
from colony.nav.himm import HimmSetting
from colony.nav.local_map import Trail
from colony.nav.pose_filter import PoseFilter, Step
from colony.nav.stickrep import Pose
from colony.nav.wall_matching import Gate, combined, matched, sighted
from colony.nav.walls import Walls
from colony.runtime.library.robot import Position


@dataclass(frozen=True, slots=True, kw_only=True)
class Correction:
    """By how much a position is off: what is to be added to it, in mm and degrees."""

    x_mm: float
    y_mm: float
    heading_deg: float

    @property
    def is_worth_telling(self) -> bool:
        """Whether it is more than the noise of the estimate."""
        return math.hypot(self.x_mm, self.y_mm) > _WORTH_MM or abs(self.heading_deg) > _WORTH_DEG


_WORTH_MM = 4.0
_WORTH_DEG = 0.15
_LEAP_MM = 1_000.0
_FASTEST_MM_S = 800.0
_SLACK_MM = 20.0
_NEAR_MM = 1_000.0
_TIMING_S = 0.02
_RETRY_SCANS = 5
_HOPEFUL_SCANS = 50
_PAUSE_SCANS = 20  # trying takes time, and who is lost for long is probably outside of the map
_TRAIL_MM = 3_000.0
_LEAST_TRAIL_MM = 1_500.0
_LINES_AFTER_SCANS = 15
_LINES_GATE = Gate(angle_deg=40.0, offset_mm=1_000.0)


class PoseTracker:
    """Where a robot is. Mutable: the filter, the newest position that it was given, the scans of the last
    meters, and the walls near by."""

    def __init__(self, walls: Walls, sonar: SonarModel | None = None) -> None:
        """Begin without a position: the first one is taken as it is."""
        self._sonar = sonar or SonarModel()
        self._ring = Ring(self._sonar)
        self._himm = HimmSetting(
            half_side_mm=_TRAIL_MM + 4_000.0,
            full_range_mm=self._sonar.full_range_mm,
            ring_mm=self._sonar.ring_mm,
        )
        self._mirrors = mirrors_of(walls)
        self._near: Mirrors | None = None
        self._near_at = (0.0, 0.0)
        self._last: Position | None = None
        self._trail = Trail(_TRAIL_MM)
        self._lost_scans = 0
        self._filter: PoseFilter | None = None

    def take(self, ranges: tuple[float, ...], at: Position) -> Correction:
        """Take in a scan and where the robot was then by its odometry; gives how far that is off.

        What is not finite says nothing: neither a range nor a position.
        """
        if not all(map(math.isfinite, (at.x, at.y, at.heading))):
            return Correction(x_mm=0.0, y_mm=0.0, heading_deg=0.0)
        scan = np.array(ranges)
        last, self._last = self._last, at
        if self._filter is None:
            self._filter = PoseFilter(self._ring, (at.x, at.y, at.heading))
        elif last is not None:
            self._move(self._filter, last, at, scan)
        near = self._around(*self._filter.state[:2].tolist())
        self._filter.listen(near, scan, _blur_rad(last, at))
        self._find_again(self._filter, near, scan)
        x, y, heading = self._filter.state[:3].tolist()
        turned = math.remainder(math.degrees(heading) - at.heading, 360.0)
        return Correction(x_mm=x - at.x, y_mm=y - at.y, heading_deg=turned)

    def told(self, by: Correction) -> None:
        """The odometry was corrected: what it says next has this in it."""
        if (last := self._last) is not None:
            heading = last.heading + by.heading_deg
            self._last = Position(x=last.x + by.x_mm, y=last.y + by.y_mm, heading=heading, t_ns=last.t_ns)

    def _move(self, filter_: PoseFilter, last: Position, at: Position, scan: Floats) -> None:
        driven = _FASTEST_MM_S * max(at.t_ns - last.t_ns, 0) / 1e9  # at most
        too_far = math.hypot(at.x - last.x, at.y - last.y) - driven
        if too_far > _LEAP_MM:  # somebody set it
            filter_.reset((at.x, at.y, at.heading))
            self._trail.clear()
        elif too_far > _SLACK_MM:  # somebody corrected it
            turned = math.remainder(at.heading - last.heading, 360.0)
            filter_.shift(at.x - last.x, at.y - last.y, math.radians(turned))
        else:
            self._trail.add(filter_.move(step_between(last, at)), scan)

    def _find_again(self, filter_: PoseFilter, near: Mirrors, scan: Floats) -> None:
        """Look for the way, where it is lost."""
        if not filter_.is_lost:
            self._lost_scans = 0
            return
        self._lost_scans += 1
        pause = _RETRY_SCANS if self._lost_scans < _HOPEFUL_SCANS else _PAUSE_SCANS
        if self._lost_scans % pause == 1 and filter_.relocate(near, scan):
            self._trail.clear()  # it is not known when the wheel slipped
        elif self._lost_scans % _LINES_AFTER_SCANS == 0 and self._trail.way_mm >= _LEAST_TRAIL_MM:
            self._match_lines(filter_, near, scan)

    def _match_lines(self, filter_: PoseFilter, near: Mirrors, scan: Floats) -> None:
        """Correct the filter by the lines in a map of the last meters."""
        x, y, heading = filter_.state[:3].tolist()
        here = Pose(x, y, math.degrees(heading))
        lines = self._trail.lines(self._himm)
        found = tuple(matched(sighted(line, here), near, here, _LINES_GATE) for line in lines)
        fix = combined(tuple(match for match in found if match is not None))
        if fix is not None:
            pose = (x + fix.x_mm, y + fix.y_mm, here.heading_deg + fix.heading_deg)
            filter_.consider(pose, near, scan)

    def _around(self, x_mm: float, y_mm: float) -> Mirrors:
        """The walls that can be heard from here; found anew after each meter."""
        moved = math.hypot(x_mm - self._near_at[0], y_mm - self._near_at[1])
        if self._near is None or moved > _NEAR_MM:
            reach = self._sonar.reach_mm + self._sonar.ring_mm + _NEAR_MM
            self._near, self._near_at = self._mirrors.near(x_mm, y_mm, reach), (x_mm, y_mm)
        return self._near


def _blur_rad(last: Position | None, at: Position) -> float:
    """By how much the heading at a scan may be off because scan and position are not quite of one moment."""
    if last is None or at.t_ns <= last.t_ns:
        return 0.0
    turned = math.radians(abs(math.remainder(at.heading - last.heading, 360.0)))
    return turned / ((at.t_ns - last.t_ns) / 1e9) * _TIMING_S


def step_between(last: Position, now: Position) -> Step:
    """How the robot moved from one position to the next, in its own frame."""
    turned = math.radians(math.remainder(now.heading - last.heading, 360.0))
    heading = math.radians(last.heading)
    dx, dy = now.x - last.x, now.y - last.y
    sine, cosine = math.sin(heading), math.cos(heading)
    return Step(-dx * sine + dy * cosine, -dx * cosine - dy * sine, turned)


def position_at(t_ns: int, now: Position, last: Position | None) -> Position:
    """Where the robot was at a time near that of its newest position, if it goes on as it went before."""
    if last is None or now.t_ns <= last.t_ns or t_ns == now.t_ns:
        return now
    part = min(max((t_ns - now.t_ns) / (now.t_ns - last.t_ns), -1.0), 1.0)
    turned = math.remainder(now.heading - last.heading, 360.0)
    return Position(
        x=now.x + part * (now.x - last.x),
        y=now.y + part * (now.y - last.y),
        heading=now.heading + part * turned,
        t_ns=t_ns,
    )
