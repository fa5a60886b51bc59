"""CTracker: counts the ceiling lights that the robot passes, and measures its position (sections 5.6, 5.8).

It waits for $TrackData, reads the distances of the lights from LightOffset, and observes the ceiling at least
twice a second. At each light it sets CeilingLight to the number of lights passed, and ups $LightDet. After
the last one it sets Overshoot to the robot's distance beyond it, and ups $EndLMode. A restarted tracker
resumes where its predecessor stopped (`track.py`). It abandons a goal when another Planner sets a goal
of another kind.

The map gives the positions of lights to within centimeters, so each valid light also measures the robot's
position along the corridor, and the tilt of its edges measures the heading. The tracker publishes both for
the pose estimator as LightFix, and corrects nothing itself. In turn it adopts the estimator's uncertainty of
the reported position. Without a pose estimator, it estimates its progress from light to light by itself, and
the scale of the odometry.

One script serves any number of cameras: their detections update the same track, so that a light seen by two
cameras is counted once. That is cheaper than the child processes of the thesis, and needs no token.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Sequence
from typing import Any

from colony.nav.pose.pose import Fix, MeasurementRow, PoseEstimate, fix_list, pose_of
from colony.nav.shared import (
    CEILING_LIGHT,
    END_L_MODE,
    LIGHT_DETECTED,
    LIGHT_FIX,
    OVERSHOOT,
    POSE,
    TRACK_DATA,
    read_variables,
)
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import data, robot
from colony.runtime.library.robot import Position
from colony.vision.detections import PERIOD_S
from colony.vision.lights.ceiling_camera import UPWARD, CeilingCameraModel
from colony.vision.lights.observing import NO_ANSWER_ERRORS, CeilingObserver, ceiling_observer, ensure_period
from colony.vision.lights.track import (
    LightDetections,
    LightPassing,
    LightTrack,
    OdometryScale,
    ProgressMeasurement,
    UnfinishedGoal,
    abandon_goal,
    end_goal,
    is_goal_abandoned,
    take_goal,
    take_new_goal_signal,
    unfinished_goal,
)

GOAL_CHECK_INTERVAL_S = 1.0
"""Seconds between two checks, while tracking, for a new goal that replaces the current one."""

TILT_SIGMA_DEG = 0.5
"""Standard deviation of the heading from the edges of a light."""

_MIN_WAIT_S = 0.02
_MAX_IMAGE_AGE_S = 1.0
_MAX_POSE_AGE_S = 1.0
_STANDING_MM = 2.0
_POSITIONS = 8


def light_tracker(
    *,
    cameras: Sequence[str] = ("CServerUp",),
    geometry: CeilingCameraModel | Sequence[CeilingCameraModel] = UPWARD,
    kind: type[LightTrack] = LightTrack,
    period_s: float = PERIOD_S,
) -> Script:
    """Count the lights of each goal, forever.

    Args:
        cameras: the servers of the cameras; without cameras, lights are passed by the position alone.
        geometry: geometry of all cameras, or of each.
        kind: the class of the tracks, which decides how lights are counted.
        period_s: seconds between two images.

    Raises:
        ValueError: the numbers of geometries and cameras differ; later, in the script: the variables of a
            goal are inconsistent.
    """
    geometries = (geometry,) * len(cameras) if isinstance(geometry, CeilingCameraModel) else tuple(geometry)
    if len(geometries) != len(cameras):
        raise ValueError(f"{len(cameras)} cameras with {len(geometries)} geometries; expected one for each")
    return _tracker(ceiling_observer(cameras, geometries), cameras, period_s, kind)


def _tracker(
    observer: CeilingObserver, cameras: Sequence[str], period_s: float, kind: type[LightTrack]
) -> Script:
    yield from ensure_period(cameras, period_s)
    for name in (TRACK_DATA, LIGHT_DETECTED, END_L_MODE):
        yield from do("DServer", data.create_semaphore(name, 0))
    scale = OdometryScale()
    has_goal = yield from take_new_goal_signal()
    unfinished = None if has_goal else (yield from unfinished_goal())
    while True:
        if unfinished is None and not has_goal:
            yield from do("DServer", data.wait(TRACK_DATA))
        goal, passed = unfinished or UnfinishedGoal((yield from take_goal()), 0)
        unfinished = None
        track = kind.start(goal, scale, passed, blind=not cameras)
        tracking = _Tracking(track, observer, period_s)
        has_goal = yield from tracking.run()
        scale = tracking.scale


class _Tracking:
    """The tracking of one goal. Mutable."""

    def __init__(self, track: LightTrack, observer: CeilingObserver, period_s: float) -> None:
        self._track = track
        self._observer = observer
        self._period_s = period_s
        self._positions: deque[Position] = deque(maxlen=_POSITIONS)
        self._observed_at_mm: float | None = None
        self._goal_checked_ns: int | None = None
        self._published_ns = -1

    @property
    def scale(self) -> OdometryScale:
        """The current estimate of the odometry's scale."""
        return self._track.reckoning.scale

    def run(self) -> Generator[Step, Any, bool]:
        """Run until all lights are passed or the goal is abandoned; return True if a new goal replaces it."""
        if self._track.done:
            yield from do("DServer", data.set(OVERSHOOT, 0.0))
            yield from end_goal()
            return False
        wait_s = 0.0
        while True:
            now_ns = yield from sleep(wait_s)
            if self._goal_check_is_due(now_ns):
                if (yield from take_new_goal_signal()):
                    return True
                if (yield from is_goal_abandoned()):
                    yield from abandon_goal()
                    return False
            wait_s = self._period_s
            pose = yield from self._pose()
            try:
                here = yield from do("RServer", robot.position())
            except NO_ANSWER_ERRORS:
                continue
            if not self._positions or here.t_ns > self._positions[-1].t_ns:
                self._positions.append(here)
            self._adopt_uncertainty(pose)
            yield from self._observe(here)
            while not self._track.done:
                progress = self._progress(self._positions[-1])
                self._track, passing = self._track.passing(progress)
                if passing is None:
                    break
                if self._track.done and (yield from take_new_goal_signal()):
                    return True  # the new goal's Planner must not be notified of the end of this one
                yield from self._publish(passing)
            if self._track.done:
                return False
            wait_s = self._wait_s()

    def _goal_check_is_due(self, now_ns: int) -> bool:
        if self._goal_checked_ns is None:
            self._goal_checked_ns = now_ns
        if now_ns - self._goal_checked_ns < GOAL_CHECK_INTERVAL_S * 1e9:
            return False
        self._goal_checked_ns = now_ns
        return True

    def _observe(self, here: Position) -> Generator[Step, Any, None]:
        """Update the track with the cameras' new images; one image is enough while the robot stands."""
        goal = self._track.goal
        at_mm = goal.progress(here.x, here.y)
        if self._observed_at_mm is not None and abs(at_mm - self._observed_at_mm) < _STANDING_MM:
            return
        observations = yield from self._observer(goal.tilt(here.heading))
        for image in observations:
            then = position_at(tuple(self._positions), image.t_ns)
            if here.t_ns - image.t_ns > _MAX_IMAGE_AGE_S * 1e9:
                continue
            self._observed_at_mm = at_mm
            detections = LightDetections(
                image.lights, goal.progress(then.x, then.y), goal.tilt(then.heading), image.t_ns
            )
            self._track = self._track.observed(detections)
            if self._track.relocation is not None:
                yield from self._publish_fix(self._track.relocation, None)

    def _publish(self, passing: LightPassing) -> Generator[Step, Any, None]:
        """Publish that a light was passed."""
        if passing.measurement is not None:
            yield from self._publish_fix(passing.measurement, passing.heading_error_deg)
        variables: dict[str, object] = {CEILING_LIGHT: passing.number}
        if self._track.done:
            variables[OVERSHOOT] = passing.beyond_mm
        yield from do("DServer", data.set_many(variables))
        yield from do("DServer", data.signal(LIGHT_DETECTED))
        if self._track.done:
            yield from end_goal()

    def _publish_fix(
        self, measurement: ProgressMeasurement, heading_error_deg: float | None
    ) -> Generator[Step, Any, None]:
        """Publish a measurement of the progress as a fix for the pose estimator.

        With `heading_error_deg`, from several images, the fix also has a row for the heading.
        """
        goal = self._track.goal
        east, north = goal.ahead
        along = east * goal.x_mm + north * goal.y_mm + measurement.place_mm
        rows = [MeasurementRow(east, north, 0.0, along, measurement.sigma_mm)]
        if heading_error_deg is not None:
            heading = math.radians(goal.direction_deg + measurement.tilt_deg + heading_error_deg)
            rows.append(MeasurementRow(0.0, 0.0, 1.0, heading, math.radians(TILT_SIGMA_DEG)))
        yield from do("DServer", data.set(LIGHT_FIX, fix_list(Fix(measurement.t_ns, tuple(rows)))))
        self._published_ns = self._positions[-1].t_ns

    def _pose(self) -> Generator[Step, Any, PoseEstimate | None]:
        """Return the estimate of the pose, or None without one.

        Read it before the position, which then includes the estimator's corrections.
        """
        variables = yield from read_variables(POSE)
        return None if variables is None else pose_of(variables[POSE])

    def _adopt_uncertainty(self, pose: PoseEstimate | None) -> None:
        """Adopt the estimator's uncertainty of the position, once the estimate includes the last fix."""
        newest = self._positions[-1]
        if pose is None or pose.t_ns <= self._published_ns:
            return
        if newest.t_ns - pose.t_ns > _MAX_POSE_AGE_S * 1e9:
            return
        sigma_mm = pose.sigma_along(*self._track.goal.ahead)
        self._track = self._track.estimated(self._progress(newest), sigma_mm)

    def _progress(self, position: Position) -> float:
        return self._track.goal.progress(position.x, position.y)

    def _wait_s(self) -> float:
        """Return the seconds until the next image: fewer if the robot passes a light before that."""
        period_s = self._period_s
        newest = self._positions[-1]
        remaining_mm = self._track.to_next(self._progress(newest))
        if remaining_mm is None or len(self._positions) < 2 or remaining_mm <= 0.0:
            return period_s
        before = self._positions[-2]
        elapsed_s = (newest.t_ns - before.t_ns) / 1e9
        travel_mm = self._progress(newest) - self._progress(before)
        if elapsed_s <= 0.0 or travel_mm <= 0.0:
            return period_s
        return min(period_s, max(_MIN_WAIT_S, remaining_mm * elapsed_s / travel_mm))


def position_at(positions: Sequence[Position], t_ns: int) -> Position:
    """Interpolate the robot's position at a time between positions that are ordered by time.

    Outside of their range, the first or last position is returned.
    """
    after = next((i for i, position in enumerate(positions) if position.t_ns >= t_ns), len(positions) - 1)
    if after == 0 or positions[after].t_ns <= t_ns:
        return positions[after]
    a, b = positions[after - 1], positions[after]
    fraction = (t_ns - a.t_ns) / (b.t_ns - a.t_ns)
    turned = (b.heading - a.heading + 180.0) % 360.0 - 180.0
    return Position(
        x=a.x + fraction * (b.x - a.x),
        y=a.y + fraction * (b.y - a.y),
        heading=a.heading + fraction * turned,
        t_ns=t_ns,
    )
