"""The pose estimator: the only client that corrects RServer's position (thesis sections 5.5, 5.6, 5.7).

Odometry, scans against the map, local maps, ceiling lights, door plates and the markers of elevators give one
pose with one covariance. A client that sees a landmark publishes a `Fix` at DServer; the estimator takes it
in once, for the pose of its moment. It publishes the estimate at DServer, and sends corrections to RServer.

In an elevator the sonars say nothing of the map: its walls are mirrors, and its cabin is on no map. On
another floor the map is another one, and the robot is where RServer says, give or take what a ride may hide.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from typing import Any

from colony.nav.asks import adjusted, asked
from colony.nav.maps.walls import Walls
from colony.nav.pose.fixes import fix_of
from colony.nav.pose.pose import pose_list
from colony.nav.pose.tracker import ALL, PoseTracker, Source, Told, position_at
from colony.nav.shared import FLOOR, GOAL_TYPE, LIGHT_FIX, MARKER_FIX, PLATE_FIX, POSE, GoalKind
from colony.runtime.kit.script import Script, Step, sleep
from colony.runtime.library import data, proximity, robot
from colony.runtime.library.proximity import SonarReading
from colony.runtime.library.robot import Position

_FIXES = {LIGHT_FIX: Source.LIGHTS, PLATE_FIX: Source.PLATES, MARKER_FIX: Source.MARKERS}
_AHEAD_NS = 1_000_000_000
"""A fix of a moment that is farther in the future is of a clock that is wrong."""
_WITH_SCANS = frozenset({Source.SONAR, Source.LOCAL_MAPS})


def pose_estimator(
    floors: Mapping[str, Walls],
    *,
    sources: frozenset[Source] = ALL,
    period_s: float = 0.1,
) -> Script:
    """Estimate the robot's pose from all sources together, and correct RServer's position, forever.

    While RServer, or what a source needs, is away or has nothing to say, it waits, or goes on without.

    Args:
        floors: the walls of each floor, by the names that FLOOR has; the first one until it is set.
        sources: the sources besides the odometry.
        period_s: seconds between two looks at the sonars and the position.

    Raises:
        ValueError: there is no floor; later, in the script: FLOOR is none of them.
    """
    if not floors:
        raise ValueError("there is no floor; expected the walls of at least one")
    return _Estimator(floors, sources).run(period_s)


class _Estimator:
    """The state of the estimator: the tracker, the floor, and the newest inputs. Mutable."""

    def __init__(self, floors: Mapping[str, Walls], sources: frozenset[Source]) -> None:
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
            # FLOOR before the position, which was adjusted before FLOOR was set.
            yield from self._look_at_floor()
            scan = None
            if self._sources & _WITH_SCANS:
                scan = yield from asked("PServer", proximity.sonar())
            where = yield from asked("RServer", robot.position())
            if where is None:
                continue
            fresh = scan if scan is not None and scan.t_ns > self._scan_ns else None
            if fresh is None and self._last is not None and where.t_ns <= self._last.t_ns:
                continue
            yield from self._take(fresh, where)

    def _take(self, scan: SonarReading | None, where: Position) -> Generator[Step, Any, None]:
        """Take in a scan, a position and the fixes of landmarks, and publish the result."""
        ranges = None
        at = where
        if scan is not None:
            self._scan_ns = scan.t_ns
            at = position_at(scan.t_ns, where, self._last)
            if not (yield from self._rides()):
                ranges = scan.ranges
        told = yield from self._fixes(where.t_ns)
        correction = self._tracker.take(ranges, at, told)
        self._last = where
        dx, dy, turn = correction.x_mm, correction.y_mm, correction.heading_deg
        if correction.is_worth_telling and (yield from adjusted(dx, dy, turn)):
            self._tracker.told(correction)
            heading = where.heading + turn
            self._last = Position(x=where.x + dx, y=where.y + dy, heading=heading, t_ns=where.t_ns)
        if (pose := self._tracker.estimate) is not None:
            yield from asked("DServer", data.set(POSE, pose_list(pose)))

    def _look_at_floor(self) -> Generator[Step, Any, None]:
        floor = yield from asked("DServer", data.get(FLOOR))
        if floor is None or floor == self._floor:
            return
        if floor not in self._floors:
            known = ", ".join(self._floors)
            raise ValueError(f"{FLOOR} is {floor!r}; expected one of {known}: set it to the name of a map")
        self._floor, self._last = floor, None
        self._tracker.enter(self._floors[floor])

    def _rides(self) -> Generator[Step, Any, bool]:
        """Return True if the robot is on its way into an elevator, or in it."""
        goal = yield from asked("DServer", data.get(GOAL_TYPE))
        return goal == GoalKind.ELEVATOR

    def _fixes(self, now_ns: int) -> Generator[Step, Any, list[Told]]:
        """Return the fixes that are new."""
        told = yield from asked("DServer", data.get_many(_FIXES))
        if told is None:
            yield from _make_fixes()
            return []
        found: list[Told] = []
        for name, source in _FIXES.items():
            fix = fix_of(told[name])
            if fix is not None and self._newest_ns[name] < fix.t_ns <= now_ns + _AHEAD_NS:
                self._newest_ns[name] = fix.t_ns
                found.append(Told(source, fix))
        return found


def _make_fixes() -> Generator[Step, Any, None]:
    """Set the fixes of each source without any to an empty list, so that all can be read at once."""
    for name in _FIXES:
        if (yield from asked("DServer", data.get(name))) is None:
            yield from asked("DServer", data.set(name, []))
