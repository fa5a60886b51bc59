"""The pose estimator: the only client that corrects RServer's position (thesis sections 5.5, 5.6, 5.7).

It fuses odometry, scans against the map, local maps, ceiling lights, door plates and the markers of elevators
into one pose with one covariance. A client that observes a landmark publishes a `Fix` at DServer; the
estimator uses each fix once, as a measurement of the pose at the fix's time. It publishes the estimate at
DServer, and sends corrections to RServer.

In an elevator the sonars are not used: the walls act as mirrors, and the cabin is not on any map. On another
floor the estimator changes the map and restarts from RServer's position, with the uncertainty of a ride.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from typing import Any

from colony.nav.maps.walls import Walls
from colony.nav.pose.pose import fix_of, pose_list
from colony.nav.pose.tracker import EVERY_SOURCE, LandmarkFix, PoseSource, PoseTracker, position_at
from colony.nav.shared import (
    FLOOR,
    GOAL_TYPE,
    LIGHT_FIX,
    MARKER_FIX,
    PLATE_FIX,
    POSE,
    GoalKind,
    try_adjust_position,
    try_ask,
)
from colony.runtime.kit.script import Script, Step, sleep
from colony.runtime.library import data, proximity, robot
from colony.runtime.library.proximity import SonarReading
from colony.runtime.library.robot import Position

_FIXES = {LIGHT_FIX: PoseSource.LIGHTS, PLATE_FIX: PoseSource.PLATES, MARKER_FIX: PoseSource.MARKERS}
_MAX_AHEAD_NS = 1_000_000_000
"""Maximum lead of a fix's time over the robot's clock; fixes from farther in the future are discarded."""
_SCAN_SOURCES = frozenset({PoseSource.SONAR, PoseSource.LOCAL_MAPS})


def pose_estimator(
    floors: Mapping[str, Walls],
    *,
    sources: frozenset[PoseSource] = EVERY_SOURCE,
    period_s: float = 0.1,
) -> Script:
    """Estimate the robot's pose from all sources together, and correct RServer's position, forever.

    While RServer does not answer, the estimator waits; a source whose server does not answer is left out.

    Args:
        floors: the walls of each floor, by the value of FLOOR; until FLOOR is set, the first floor is used.
        sources: the sources used besides the odometry.
        period_s: seconds between two readings of the sonars and the position.

    Raises:
        ValueError: `floors` is empty; later, in the script: FLOOR is none of them.
    """
    if not floors:
        raise ValueError("there is no floor; expected the walls of at least one")
    return _Estimator(floors, sources).run(period_s)


class _Estimator:
    """The estimator's state: the tracker, the floor, and the newest inputs. Mutable."""

    def __init__(self, floors: Mapping[str, Walls], sources: frozenset[PoseSource]) -> None:
        self._floors, self._sources = floors, sources
        self._floor = next(iter(floors))
        self._tracker = PoseTracker(floors[self._floor], sources=sources)
        self._newest_ns = dict.fromkeys(_FIXES, -1)
        self._scan_ns = -1
        self._last: Position | None = None

    def run(self, period_s: float) -> Script:
        """Estimate the pose forever."""
        while True:
            yield from sleep(period_s)
            # Read FLOOR before the position: the Planner adjusts the position, then sets FLOOR.
            yield from self._update_floor()
            scan = None
            if self._sources & _SCAN_SOURCES:
                scan = yield from try_ask("PServer", proximity.sonar())
            position = yield from try_ask("RServer", robot.position())
            if position is None:
                continue
            new_scan = scan if scan is not None and scan.t_ns > self._scan_ns else None
            if new_scan is None and self._last is not None and position.t_ns <= self._last.t_ns:
                continue
            yield from self._process(new_scan, position)

    def _process(self, scan: SonarReading | None, position: Position) -> Generator[Step, Any, None]:
        """Update the tracker with a scan, a position and the fixes of landmarks, and publish the result."""
        ranges = None
        scan_position = position
        if scan is not None:
            self._scan_ns = scan.t_ns
            scan_position = position_at(scan.t_ns, position, self._last)
            if not (yield from self._is_riding()):
                ranges = scan.ranges
        fixes = yield from self._fixes(position.t_ns)
        correction = self._tracker.update(ranges, scan_position, fixes)
        self._last = position
        dx, dy, turn = correction.x_mm, correction.y_mm, correction.heading_deg
        if correction.is_significant and (yield from try_adjust_position(dx, dy, turn)):
            self._tracker.record_correction(correction)
            heading = position.heading + turn
            self._last = Position(x=position.x + dx, y=position.y + dy, heading=heading, t_ns=position.t_ns)
        if (pose := self._tracker.estimate) is not None:
            yield from try_ask("DServer", data.set(POSE, pose_list(pose)))

    def _update_floor(self) -> Generator[Step, Any, None]:
        floor = yield from try_ask("DServer", data.get(FLOOR))
        if floor is None or floor == self._floor:
            return
        if floor not in self._floors:
            known = ", ".join(self._floors)
            raise ValueError(f"{FLOOR} is {floor!r}; expected one of {known}: set it to the name of a map")
        self._floor, self._last = floor, None
        self._tracker.enter(self._floors[floor])

    def _is_riding(self) -> Generator[Step, Any, bool]:
        """Return True if the robot is entering an elevator, in it, or leaving it."""
        goal = yield from try_ask("DServer", data.get(GOAL_TYPE))
        return goal == GoalKind.ELEVATOR

    def _fixes(self, now_ns: int) -> Generator[Step, Any, list[LandmarkFix]]:
        """Return the fixes that have not been used yet."""
        values = yield from try_ask("DServer", data.get_many(_FIXES))
        if values is None:
            yield from _create_fix_variables()
            return []
        found: list[LandmarkFix] = []
        for name, source in _FIXES.items():
            fix = fix_of(values[name])
            if fix is not None and self._newest_ns[name] < fix.t_ns <= now_ns + _MAX_AHEAD_NS:
                self._newest_ns[name] = fix.t_ns
                found.append(LandmarkFix(source, fix))
        return found


def _create_fix_variables() -> Generator[Step, Any, None]:
    """Set unset fix variables to an empty list, so that all of them can be read in one call."""
    for name in _FIXES:
        if (yield from try_ask("DServer", data.get(name))) is None:
            yield from try_ask("DServer", data.set(name, []))
