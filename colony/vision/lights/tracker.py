"""CTracker: counts the ceiling lights that the robot passes, and measures its place (sections 5.6 and 5.8).

It waits for $TrackData, reads the lights to come from LightOffset, and looks at the ceiling twice a second or
more often. CeilingLight is the number of lights passed; at each, $LightDet is upped. After the last one
Overshoot is how far beyond it the robot is, and $EndLMode is upped. A restarted tracker resumes where the one
before it ended (`track_goals.py`). Lights are given up if the robot meanwhile has a goal of another kind,
from another Planner.

The map knows the place of a light to centimeters, so each valid light also gives the robot's place along the
corridor, and its tilted edges the heading. That goes to the pose estimator as LightFix; the tracker corrects
nothing itself. In turn it trusts the reported position as far as the estimator does. Without a pose
estimator, it reckons by itself, from light to light, and learns the scale of the odometry.

One script does that for any number of cameras: their lights meet in the same track, where one that is seen by
two cameras is still one light. That is cheaper than the child processes of the thesis, and needs no token.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Sequence
from typing import Any

from colony.nav.asks import values
from colony.nav.pose.fixes import Fix, Row, fix_list
from colony.nav.pose.pose import PoseEstimate, pose_of
from colony.nav.shared import (
    CEILING_LIGHT,
    END_L_MODE,
    LIGHT_DETECTED,
    LIGHT_FIX,
    OVERSHOOT,
    POSE,
    TRACK_DATA,
)
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import data, robot
from colony.runtime.library.robot import Position
from colony.vision.lights.along_track import Scale
from colony.vision.lights.ceiling_camera import UPWARD, CeilingCamera
from colony.vision.lights.looks import SILENT, Looker, cameras_looker, hurry
from colony.vision.lights.thesis_track import ThesisTrack
from colony.vision.lights.track import LightTrack, Passing, Seen, Sighting
from colony.vision.lights.track_goals import (
    Unfinished,
    end_goal,
    give_up,
    is_given_up,
    new_goal,
    take_goal,
    unfinished_goal,
)
from colony.vision.periods import PERIOD_S, THESIS_PERIOD_S

ASK_AGAIN_S = 1.0
"""Seconds between two checks, while tracking, for a new goal that replaces the present one."""

TILT_SIGMA_DEG = 0.5
"""Standard deviation of the heading from the edges of a light."""

_SOONEST_S = 0.02
_OLDEST_IMAGE_S = 1.0
_OLDEST_POSE_S = 1.0
_STANDING_MM = 2.0
_POSITIONS = 8

Track = LightTrack | ThesisTrack


def light_tracker(
    *,
    cameras: Sequence[str] = ("CServerUp",),
    geometry: CeilingCamera | Sequence[CeilingCamera] = UPWARD,
    thesis: bool = False,
) -> Script:
    """Return CTracker, which looks at its cameras itself.

    Args:
        cameras: the cameras; without any, lights are passed by the position alone.
        geometry: geometry of all cameras, or of each.
        thesis: count as printed, and publish no fix.

    Raises:
        ValueError: there is not a geometry for each camera; later, in the script: the variables of a goal are
            not what the Planner should have set.
    """
    geometries = (geometry,) * len(cameras) if isinstance(geometry, CeilingCamera) else tuple(geometry)
    if len(geometries) != len(cameras):
        raise ValueError(f"{len(cameras)} cameras with {len(geometries)} geometries; expected one for each")
    period = THESIS_PERIOD_S if thesis else PERIOD_S
    return _tracker(cameras_looker(cameras, geometries), cameras, period, thesis)


def _tracker(looker: Looker, cameras: Sequence[str], period_s: float, thesis: bool) -> Script:
    yield from hurry(cameras, period_s)
    for name in (TRACK_DATA, LIGHT_DETECTED, END_L_MODE):
        yield from do("DServer", data.create_semaphore(name, 0))
    scale = Scale()
    again = yield from new_goal()
    left = None if again else (yield from unfinished_goal())
    while True:
        if left is None and not again:
            yield from do("DServer", data.wait(TRACK_DATA))
        goal, passed = left or Unfinished((yield from take_goal()), 0)
        left = None
        track: Track = (
            ThesisTrack.start(goal, passed)
            if thesis
            else LightTrack.start(goal, scale, passed, blind=not cameras)
        )
        tracking = _Tracking(track, looker, period_s)
        again = yield from tracking.run()
        scale = tracking.scale(scale)


class _Tracking:
    """One goal. Mutable: the track, and the robot's last positions, oldest first."""

    def __init__(self, track: Track, looker: Looker, period_s: float) -> None:
        self._track = track
        self._looker = looker
        self._period_s = period_s
        self._positions: deque[Position] = deque(maxlen=_POSITIONS)
        self._looked_at_mm: float | None = None
        self._asked_ns: int | None = None
        self._told_ns = -1

    def scale(self, known: Scale) -> Scale:
        """Return the present estimate of the odometry's scale."""
        return self._track.reckoning.scale if isinstance(self._track, LightTrack) else known

    def run(self) -> Generator[Step, Any, bool]:
        """Run until all lights are passed or given up; return True if a new goal replaces this one."""
        if self._track.done:
            yield from do("DServer", data.set(OVERSHOOT, 0.0))
            yield from end_goal()
            return False
        wait_s = 0.0
        while True:
            now_ns = yield from sleep(wait_s)
            if self._is_time_to_ask(now_ns):
                if (yield from new_goal()):
                    return True
                if (yield from is_given_up()):
                    yield from give_up()
                    return False
            wait_s = self._period_s
            pose = yield from self._pose()
            try:
                here = yield from do("RServer", robot.position())
            except SILENT:
                continue
            if not self._positions or here.t_ns > self._positions[-1].t_ns:
                self._positions.append(here)
            self._believe(pose)
            yield from self._look(here)
            while not self._track.done:
                progress = self._progress(self._positions[-1])
                self._track, passing = self._track.passing(progress)
                if passing is None:
                    break
                if self._track.done and (yield from new_goal()):
                    return True  # its Planner must not be notified of the end of this one
                yield from self._tell(passing)
            if self._track.done:
                return False
            wait_s = self._wait_s()

    def _is_time_to_ask(self, now_ns: int) -> bool:
        if self._asked_ns is None:
            self._asked_ns = now_ns
        if now_ns - self._asked_ns < ASK_AGAIN_S * 1e9:
            return False
        self._asked_ns = now_ns
        return True

    def _look(self, here: Position) -> Generator[Step, Any, None]:
        """Take in what the cameras show. While the robot stands, one look is enough."""
        goal = self._track.goal
        at_mm = goal.progress(here.x, here.y)
        if self._looked_at_mm is not None and abs(at_mm - self._looked_at_mm) < _STANDING_MM:
            return
        looks = yield from self._looker(goal.tilt(here.heading))
        for look in looks:
            then = position_at(tuple(self._positions), look.t_ns)
            if here.t_ns - look.t_ns > _OLDEST_IMAGE_S * 1e9:
                continue
            self._looked_at_mm = at_mm
            seen = Seen(look.lights, goal.progress(then.x, then.y), goal.tilt(then.heading), look.t_ns)
            self._track = self._track.seen(seen)
            if isinstance(self._track, LightTrack) and self._track.found is not None:
                yield from self._tell_fix(self._track.found, None)

    def _tell(self, passing: Passing) -> Generator[Step, Any, None]:
        """Return a light was passed."""
        if passing.sighting is not None:
            yield from self._tell_fix(passing.sighting, passing.turned_deg)
        told: dict[str, object] = {CEILING_LIGHT: passing.number}
        if self._track.done:
            told[OVERSHOOT] = passing.beyond_mm
        yield from do("DServer", data.set_many(told))
        yield from do("DServer", data.signal(LIGHT_DETECTED))
        if self._track.done:
            yield from end_goal()

    def _tell_fix(self, sighting: Sighting, turned_deg: float | None) -> Generator[Step, Any, None]:
        """Publish an image's observation of the place along the corridor as a fix for the pose estimator.

        With `turned_deg`, the heading's correction by several images, it has a row for the heading, too.
        """
        goal = self._track.goal
        east, north = goal.ahead
        along = east * goal.x_mm + north * goal.y_mm + sighting.place_mm
        rows = [Row(east, north, 0.0, along, sighting.sigma_mm)]
        if turned_deg is not None:
            heading = math.radians(goal.direction_deg + sighting.tilt_deg + turned_deg)
            rows.append(Row(0.0, 0.0, 1.0, heading, math.radians(TILT_SIGMA_DEG)))
        yield from do("DServer", data.set(LIGHT_FIX, fix_list(Fix(sighting.t_ns, tuple(rows)))))
        self._told_ns = self._positions[-1].t_ns

    def _pose(self) -> Generator[Step, Any, PoseEstimate | None]:
        """Return the estimate of the pose, or None if there is none.

        Read it before the position, which then includes the estimator's corrections.
        """
        if isinstance(self._track, ThesisTrack):
            return None
        told = yield from values(POSE)
        return None if told is None else pose_of(told[POSE])

    def _believe(self, pose: PoseEstimate | None) -> None:
        """Trust the reported position as far as the estimator does, once it has the last fix."""
        newest = self._positions[-1]
        if pose is None or not isinstance(self._track, LightTrack) or pose.t_ns <= self._told_ns:
            return
        if newest.t_ns - pose.t_ns > _OLDEST_POSE_S * 1e9:
            return
        sigma_mm = pose.sigma_along(*self._track.goal.ahead)
        self._track = self._track.estimated(self._progress(newest), sigma_mm)

    def _progress(self, position: Position) -> float:
        return self._track.goal.progress(position.x, position.y)

    def _wait_s(self) -> float:
        """Return the seconds until the next look: fewer if the robot's center comes below a light before."""
        period_s = self._period_s
        newest = self._positions[-1]
        rest_mm = self._track.to_next(self._progress(newest))
        if rest_mm is None or len(self._positions) < 2 or rest_mm <= 0.0:
            return period_s
        before = self._positions[-2]
        passed_s = (newest.t_ns - before.t_ns) / 1e9
        way_mm = self._progress(newest) - self._progress(before)
        if passed_s <= 0.0 or way_mm <= 0.0:
            return period_s
        return min(period_s, max(_SOONEST_S, rest_mm * passed_s / way_mm))


def position_at(positions: Sequence[Position], t_ns: int) -> Position:
    """Return where the robot was at a time, from positions in the order of their times.

    The place is on the straight way between the two positions around that time, or is the first or last one.
    """
    after = next((i for i, position in enumerate(positions) if position.t_ns >= t_ns), len(positions) - 1)
    if after == 0 or positions[after].t_ns <= t_ns:
        return positions[after]
    a, b = positions[after - 1], positions[after]
    part = (t_ns - a.t_ns) / (b.t_ns - a.t_ns)
    turned = (b.heading - a.heading + 180.0) % 360.0 - 180.0
    return Position(
        x=a.x + part * (b.x - a.x),
        y=a.y + part * (b.y - a.y),
        heading=a.heading + part * turned,
        t_ns=t_ns,
    )
