"""The pose tracker: follows a robot through the map of its floor by odometry, sonar and landmarks.

Normally the position filter alone tracks the pose. If it is lost, for example because a wheel slipped, the
tracker tries headings around the estimated one on single scans. If that fails, it builds a local map of the
last meters and matches the lines in it to the walls. Without `PoseSource.SONAR`, the pose is tracked by a
sequence of such local maps instead.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np

from colony.nav.mapping.himm import HimmParameters
from colony.nav.mapping.local_map import ScanTrail
from colony.nav.mapping.wall_matching import Gate, WallMatch, combine_matches, in_building_frame, match_wall
from colony.nav.maps.stickrep.model import Pose
from colony.nav.maps.walls import Walls
from colony.nav.pose.echoes import Floats, Reflectors, SonarRing, reflectors_of, rome_sonars
from colony.nav.pose.filter import JumpLimit, PoseFilter
from colony.nav.pose.pose import Fix, MeasurementRow, MotionHistory, OdometryStep, PoseEstimate
from colony.runtime.library.robot import Position


class PoseSource(Enum):
    """A source of the robot's pose besides its odometry."""

    SONAR = "sonar"  # scans against the map
    LOCAL_MAPS = "local-maps"  # lines in maps of the last meters, matched to the walls of the map
    LIGHTS = "lights"
    PLATES = "plates"
    MARKERS = "markers"


EVERY_SOURCE = frozenset(PoseSource)


class LandmarkFix(NamedTuple):
    """A fix and its source."""

    source: PoseSource
    fix: Fix


@dataclass(frozen=True, slots=True, kw_only=True)
class Correction:
    """The correction to add to a position, in mm and degrees."""

    x_mm: float
    y_mm: float
    heading_deg: float

    @property
    def is_significant(self) -> bool:
        """True if the correction exceeds the noise of the estimate."""
        return math.hypot(self.x_mm, self.y_mm) > _SIGNIFICANT_MM or abs(self.heading_deg) > _SIGNIFICANT_DEG


_SIGNIFICANT_MM = 4.0
_SIGNIFICANT_DEG = 0.15
_JUMP_MM = 1_000.0
_MAX_SPEED_MM_S = 800.0
_SLACK_MM = 20.0
_SEARCH_INTERVAL_MM = 1_000.0
_TIMING_SIGMA_S = 0.02
_RETRY_INTERVAL_SCANS = 5
_FREQUENT_RETRY_SCANS = 50
# Relocation is expensive, and a robot that stays lost is probably outside the map.
_RARE_RETRY_INTERVAL_SCANS = 20
_TRAIL_MM = 3_000.0
_MIN_TRAIL_MM = 1_500.0
_NO_STEP = OdometryStep(0.0, 0.0, 0.0)
_MAX_PENDING = 20
_LINES_AFTER_SCANS = 15
_LINES_GATE = Gate(angle_deg=40.0, offset_mm=1_000.0)
_MIN_LINE_SIGMA_MM, _MIN_LINE_SIGMA_DEG = 20.0, 0.3  # lower bounds: the map's walls are not exact
# Two lights may relocate a lost robot; a plate or a marker may be mistaken for another one.
_JUMP_LIMITS = {
    PoseSource.LIGHTS: JumpLimit(2_600.0, math.radians(20.0)),
    PoseSource.PLATES: JumpLimit(400.0, math.radians(10.0)),
    PoseSource.MARKERS: JumpLimit(600.0, math.radians(15.0)),
    PoseSource.LOCAL_MAPS: JumpLimit(_LINES_GATE.offset_mm, math.radians(_LINES_GATE.angle_deg)),
}
# After a ride, during which only odometry was available.
_NEW_FLOOR_SIGMA_MM, _NEW_FLOOR_SIGMA_DEG = 150.0, 4.0


class PoseTracker:
    """A tracker of the robot's pose. Mutable.

    It holds the filter, the newest position, the motion and scans of the last meters, the nearby reflectors,
    and fixes that are newer than the newest position.
    """

    def __init__(self, walls: Walls, *, sources: frozenset[PoseSource] = EVERY_SOURCE) -> None:
        """Start without a position: the first one is adopted unchanged."""
        self._sonar = rome_sonars()
        self._sources = sources
        self._ring = SonarRing(self._sonar)
        self._himm = HimmParameters(
            half_side_mm=_TRAIL_MM + 4_000.0,
            sonars=self._sonar,
        )
        self._reflectors = reflectors_of(walls)
        self._nearby: Reflectors | None = None
        self._nearby_at = (0.0, 0.0)
        self._last: Position | None = None
        self._trail = ScanTrail(_TRAIL_MM)
        self._history = MotionHistory()
        self._pending: tuple[LandmarkFix, ...] = ()
        self._lost_scans = 0
        self._filter: PoseFilter | None = None

    @property
    def estimate(self) -> PoseEstimate | None:
        """Estimate of the robot's pose at the newest position; None before the first one."""
        if self._filter is None or self._last is None:
            return None
        x, y, heading = self._filter.state[:3].tolist()
        degrees = np.array([1.0, 1.0, math.degrees(1.0)])
        c = self._filter.covariance[:3, :3] * np.outer(degrees, degrees)
        upper = (float(c[i, j]) for i in range(3) for j in range(i, 3))
        return PoseEstimate(self._last.t_ns, x, y, math.degrees(heading) % 360.0, *upper)

    def enter(self, walls: Walls) -> None:
        """Enter another floor, and restart from the next position."""
        self._reflectors, self._nearby = reflectors_of(walls), None
        self._last, self._pending = None, ()

    def update(
        self, ranges: Sequence[float] | None, position: Position, fixes: Iterable[LandmarkFix] = ()
    ) -> Correction:
        """Update with a scan, its odometry and the fixes of landmarks; return the correction of the odometry.

        `ranges` is None without a scan. Ranges and positions that are not finite are ignored. Fixes newer
        than the position are kept until their time.
        """
        if not all(map(math.isfinite, (position.x, position.y, position.heading))):
            return Correction(x_mm=0.0, y_mm=0.0, heading_deg=0.0)
        scan = None if ranges is None else np.array(ranges, dtype=np.float64)
        last, self._last = self._last, position
        if self._filter is None:
            self._filter = PoseFilter(self._ring, (position.x, position.y, position.heading))
            self._history.restart(position.t_ns)
        elif last is None:
            self._restart(self._filter, position, (_NEW_FLOOR_SIGMA_MM, _NEW_FLOOR_SIGMA_DEG))
        else:
            self._move(self._filter, last, position, scan)
        self._apply_fixes(self._filter, fixes)
        if scan is not None:
            self._apply_scan(self._filter, scan, _blur_rad(last, position))
        x, y, heading = self._filter.state[:3].tolist()
        turned = math.remainder(math.degrees(heading) - position.heading, 360.0)
        return Correction(x_mm=x - position.x, y_mm=y - position.y, heading_deg=turned)

    def record_correction(self, correction: Correction) -> None:
        """Record that the odometry was corrected: from now on its positions include the correction."""
        if (last := self._last) is not None:
            heading = last.heading + correction.heading_deg
            self._last = Position(
                x=last.x + correction.x_mm, y=last.y + correction.y_mm, heading=heading, t_ns=last.t_ns
            )

    def _restart(
        self, filter_: PoseFilter, position: Position, sigma: tuple[float | None, float | None] = (None, None)
    ) -> None:
        """Restart the filter at another position."""
        filter_.reset((position.x, position.y, position.heading), *sigma)
        self._trail.clear()
        self._history.restart(position.t_ns)

    def _move(self, filter_: PoseFilter, last: Position, position: Position, scan: Floats | None) -> None:
        farthest = _MAX_SPEED_MM_S * max(position.t_ns - last.t_ns, 0) / 1e9
        excess = math.hypot(position.x - last.x, position.y - last.y) - farthest
        if excess > _JUMP_MM:  # another client set the position
            self._restart(filter_, position)
        elif excess > _SLACK_MM:  # another client corrected the position
            turned = math.remainder(position.heading - last.heading, 360.0)
            filter_.shift(position.x - last.x, position.y - last.y, math.radians(turned))
            self._history.add(position.t_ns, _NO_STEP)
        else:
            step = filter_.move(step_between(last, position))
            self._history.add(position.t_ns, step)
            self._trail.add(step, scan)

    def _apply_fixes(self, filter_: PoseFilter, fixes: Iterable[LandmarkFix]) -> None:
        """Update the filter with the fixes that are not newer than the newest position."""
        waiting = (*self._pending, *(fix for fix in fixes if fix.source in self._sources))
        self._pending = tuple(pending for pending in waiting if pending.fix.t_ns > self._history.t_ns)[
            -_MAX_PENDING:
        ]
        for source, fix in waiting:
            motion = self._history.motion_since(fix.t_ns)
            if fix.t_ns > self._history.t_ns or motion is None:
                continue
            for row in fix.rows:
                filter_.observe(row, motion, _JUMP_LIMITS[source])

    def _apply_scan(self, filter_: PoseFilter, scan: Floats, blur_rad: float) -> None:
        """Update the filter with a scan."""
        reflectors = self._nearby_reflectors(*filter_.state[:2].tolist())
        if PoseSource.SONAR in self._sources:
            filter_.observe_scan(reflectors, scan, blur_rad)
            self._relocate(filter_, reflectors, scan)
        elif PoseSource.LOCAL_MAPS in self._sources and self._trail.travel_mm >= _MIN_TRAIL_MM:
            for match in self._matches(filter_, reflectors):
                for row in _measurements(match, filter_.state):
                    filter_.observe(row, limit=_JUMP_LIMITS[PoseSource.LOCAL_MAPS])
            self._trail.clear()  # so that each scan is used once

    def _relocate(self, filter_: PoseFilter, reflectors: Reflectors, scan: Floats) -> None:
        """Relocate the filter if it is lost."""
        if not filter_.is_lost:
            self._lost_scans = 0
            return
        self._lost_scans += 1
        interval = (
            _RETRY_INTERVAL_SCANS if self._lost_scans < _FREQUENT_RETRY_SCANS else _RARE_RETRY_INTERVAL_SCANS
        )
        if self._lost_scans % interval == 1 and filter_.relocate(reflectors, scan):
            self._trail.clear()  # the time of the slip is unknown
        elif PoseSource.LOCAL_MAPS not in self._sources:
            return
        elif self._lost_scans % _LINES_AFTER_SCANS == 0 and self._trail.travel_mm >= _MIN_TRAIL_MM:
            self._match_lines(filter_, reflectors, scan)

    def _match_lines(self, filter_: PoseFilter, reflectors: Reflectors, scan: Floats) -> None:
        """Correct the filter by the lines in a map of the last meters."""
        x, y, heading = filter_.state[:3].tolist()
        correction = combine_matches(self._matches(filter_, reflectors))
        if correction is not None:
            pose = (x + correction.x_mm, y + correction.y_mm, math.degrees(heading) + correction.heading_deg)
            filter_.adopt_if_better(pose, reflectors, scan)

    def _matches(self, filter_: PoseFilter, reflectors: Reflectors) -> tuple[WallMatch, ...]:
        """Match the lines in a map of the last meters to walls."""
        x, y, heading = filter_.state[:3].tolist()
        here = Pose(x, y, math.degrees(heading))
        lines = self._trail.lines(self._himm)
        found = (match_wall(in_building_frame(line, here), reflectors, here, _LINES_GATE) for line in lines)
        return tuple(match for match in found if match is not None)

    def _nearby_reflectors(self, x_mm: float, y_mm: float) -> Reflectors:
        """Return the reflectors in reach of a position; the search is repeated after each meter."""
        moved = math.hypot(x_mm - self._nearby_at[0], y_mm - self._nearby_at[1])
        if self._nearby is None or moved > _SEARCH_INTERVAL_MM:
            reach = self._sonar.reach_mm + self._sonar.ring_mm + _SEARCH_INTERVAL_MM
            self._nearby, self._nearby_at = self._reflectors.within(x_mm, y_mm, reach), (x_mm, y_mm)
        return self._nearby


def _blur_rad(last: Position | None, position: Position) -> float:
    """Return the standard deviation of the heading due to the time difference between scan and position."""
    if last is None or position.t_ns <= last.t_ns:
        return 0.0
    turned = math.radians(abs(math.remainder(position.heading - last.heading, 360.0)))
    return turned / ((position.t_ns - last.t_ns) / 1e9) * _TIMING_SIGMA_S


def _measurements(match: WallMatch, state: Floats) -> tuple[MeasurementRow, ...]:
    """Return the measurements by a matched wall: the heading, and the distance of the wall."""
    x, y, heading = state[:3].tolist()
    wall_distance = match.normal_x * x + match.normal_y * y + match.shift_mm
    turned = heading + math.radians(match.turn_deg)
    return (
        MeasurementRow(
            0.0, 0.0, 1.0, turned, math.radians(math.hypot(match.turn_sd_deg, _MIN_LINE_SIGMA_DEG))
        ),
        MeasurementRow(
            match.normal_x,
            match.normal_y,
            0.0,
            wall_distance,
            math.hypot(match.shift_sd_mm, _MIN_LINE_SIGMA_MM),
        ),
    )


def step_between(last: Position, now: Position) -> OdometryStep:
    """Return the motion of the robot from one position to the next, in its own frame."""
    turned = math.radians(math.remainder(now.heading - last.heading, 360.0))
    heading = math.radians(last.heading)
    dx, dy = now.x - last.x, now.y - last.y
    sine, cosine = math.sin(heading), math.cos(heading)
    return OdometryStep(-dx * sine + dy * cosine, -dx * cosine - dy * sine, turned)


def position_at(t_ns: int, now: Position, last: Position | None) -> Position:
    """Extrapolate or interpolate the robot's position at a time near its newest one, at constant speed."""
    if last is None or now.t_ns <= last.t_ns or t_ns == now.t_ns:
        return now
    fraction = min(max((t_ns - now.t_ns) / (now.t_ns - last.t_ns), -1.0), 1.0)
    turned = math.remainder(now.heading - last.heading, 360.0)
    return Position(
        x=now.x + fraction * (now.x - last.x),
        y=now.y + fraction * (now.y - last.y),
        heading=now.heading + fraction * turned,
        t_ns=t_ns,
    )
