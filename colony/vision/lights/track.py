"""The count of a corridor's ceiling lights, and the resulting position of the robot (thesis section 5.6).

The map gives the positions of the lights along the corridor. A detected light is *valid* if its position, by
the robot's progress and by its distance ahead, agrees with one of the map. The gate is 3 standard deviations
of the robot's progress, which grow with the distance since the last valid light, plus the loss of a slipping
wheel; it is always less than half of the distance between lights, so that two are never confused.

A light counts when the robot's center is below it. A light that is out is passed by dead reckoning, when the
robot is beyond all positions where the light could be; positions that the camera sees dark are excluded.

A light where none is expected is a stray: a reflection, or a sign that the robot is lost. Two successive
strays with the spacing of two lights of the map show that the robot is lost, and relocate it.

A `ProgressMeasurement` comes from a single light in a single image: the pose estimator fuses it with its
other sources, and must not use the same information twice.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate, combinations, pairwise
from statistics import median
from typing import Any, NamedTuple

from colony.nav.shared import (
    CEILING_LIGHT,
    END_L_MODE,
    GOAL_DIRECTION,
    GOAL_DISTANCE,
    GOAL_TYPE,
    LIGHT_OFFSET,
    TRACK_DATA,
    TRACK_START,
    GoalKind,
    read_variables,
    try_wait,
)
from colony.runtime.kit.script import Step, do
from colony.runtime.library import data, robot
from colony.vision.lights.scan_lines import MAX_TILT_DEG, SeenLight

# --- along track --------------------------------------------------------------------------------------
#
# The progress of a robot along a straight track: a one-dimensional Kalman filter of odometry and landmarks.
#
# The odometry gives the *reported* progress, in mm along the track. The true progress is that plus an error.
# Over a distance d, the error grows by the odometry's scale error times d, and by wheel slip; a landmark at a
# known position measures the error itself. So the filter has two states, the error and the scale error, with
# their covariance. The scale error is kept from track to track, because it belongs to the robot.
#
# A wheel that slips on a metal joint loses some centimeters at once. Such a jump must not change the scale
# error: a landmark whose innovation exceeds a gate updates the error alone.

START_SIGMA_MM = 150.0
"""Standard deviation of the position at the start of a track, after a corner."""

SCALE_SIGMA = 0.012
"""Initial standard deviation of the odometry's scale error."""

SLIP_MM2_PER_MM = 0.03
"""Growth of the error's variance per mm traveled: 40 mm after 50 m."""

_JUMP_SIGMAS = 2.5


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryScale:
    """The odometry's scale error, 0.01 if it reports 990 mm for a meter, and its variance."""

    error: float = 0.0
    variance: float = SCALE_SIGMA**2


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackEstimate:
    """The estimate at the reported progress `at_mm`.

    `error_mm` is the true progress minus the reported one, with its `variance`; `scale` is the scale error
    with its own variance; `covariance` is the covariance of both errors.
    """

    at_mm: float = 0.0
    error_mm: float = 0.0
    variance: float = START_SIGMA_MM**2
    covariance: float = 0.0
    scale: OdometryScale = OdometryScale()

    @property
    def progress_mm(self) -> float:
        """The best estimate of the true progress."""
        return self.at_mm + self.error_mm

    def moved(self, at_mm: float) -> TrackEstimate:
        """Return the prediction at the reported progress `at_mm`."""
        travel_mm = at_mm - self.at_mm
        return replace(
            self,
            at_mm=at_mm,
            error_mm=self.error_mm + self.scale.error * travel_mm,
            variance=self.variance
            + max(2.0 * travel_mm * self.covariance + travel_mm * travel_mm * self.scale.variance, 0.0)
            + SLIP_MM2_PER_MM * abs(travel_mm),
            covariance=self.covariance + travel_mm * self.scale.variance,
        )

    def updated(self, error_mm: float, variance: float) -> TrackEstimate:
        """Return the estimate updated with a landmark's measurement of the error."""
        innovation = error_mm - self.error_mm
        innovation_variance = self.variance + variance
        jumped = innovation * innovation > _JUMP_SIGMAS**2 * innovation_variance
        if jumped:
            innovation_variance = innovation * innovation + variance
        gain = 1.0 - variance / innovation_variance
        scale_gain = 0.0 if jumped else self.covariance / innovation_variance
        learned = OdometryScale(
            error=self.scale.error + scale_gain * innovation,
            variance=self.scale.variance - scale_gain * self.covariance,
        )
        return replace(
            self,
            error_mm=self.error_mm + gain * innovation,
            variance=gain * variance,
            covariance=0.0 if jumped else (1.0 - gain) * self.covariance,
            scale=learned,
        )

    def corrected(self, correction_mm: float) -> TrackEstimate:
        """Return the estimate after the reported progress was corrected by `correction_mm`."""
        return replace(self, at_mm=self.at_mm + correction_mm, error_mm=self.error_mm - correction_mm)

    def anchored(self, error_mm: float, sigma_mm: float) -> TrackEstimate:
        """Return the estimate with an error from another source; the scale error is kept."""
        return replace(self, error_mm=error_mm, variance=sigma_mm**2, covariance=0.0)

    @property
    def sigma_mm(self) -> float:
        """The standard deviation of the progress."""
        return math.sqrt(self.variance)


# --- track --------------------------------------------------------------------------------------------

LIGHT_SIGMA_MM = 20.0
"""Standard deviation of a light's position on the map."""

DETECTION_SIGMA_MM = 15.0
"""Standard deviation of a light's distance in one image, from pixels and the time from image to odometry."""

SLIP_MM = 160.0
"""Distance lost by two slips of the wheels."""

_IN_VIEW_MM = 420.0  # a light whose center is within this distance is entirely in view
_DARK_IMAGES = 3  # images without the light that show that it is out
_SPACING_FRACTION = 0.45
# Only the newest errors are kept, as other clients also correct the position.
_MAX_ERRORS, _MAX_HEADING_ERRORS = 5, 3
_STRAY_MM = 200.0
_STRAY_TIMES = 2
_PAIR_MM, _PAIR_FRACTION = 120.0, 0.03
LOST_SIGMA_MM = 60.0
"""Standard deviation of a robot's progress after relocation by two lights."""

_MAX_GATE_MM = 2_500.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LightGoal:
    """A track below lights: direction (0 north, 90 west), start, and distances of the lights from it."""

    direction_deg: float
    x_mm: float
    y_mm: float
    lights_mm: tuple[float, ...]

    @property
    def ahead(self) -> tuple[float, float]:
        """The unit vector of the direction, x east and y north."""
        heading = math.radians(self.direction_deg)
        return -math.sin(heading), math.cos(heading)

    def progress(self, x_mm: float, y_mm: float) -> float:
        """Return the progress of a point along the direction, in mm from the start."""
        east, north = self.ahead
        return (x_mm - self.x_mm) * east + (y_mm - self.y_mm) * north

    def tilt(self, heading_deg: float) -> float:
        """Return a heading minus the direction, in degrees counterclockwise, from -180 to 180."""
        return math.remainder(heading_deg - self.direction_deg, 360.0)


class LightDetections(NamedTuple):
    """The lights in an image, with the robot's reported progress and tilt at the time of the image."""

    lights: tuple[SeenLight, ...]
    progress_mm: float
    tilt_deg: float
    t_ns: int = 0


class ProgressMeasurement(NamedTuple):
    """A measurement of the robot's true progress at the time of an image, by a light at a known position.

    `error_mm` is the true progress minus the reported one, `tilt_deg` the reported tilt, and `sigma_mm` the
    standard deviation.
    """

    t_ns: int
    place_mm: float
    error_mm: float
    tilt_deg: float
    sigma_mm: float


class LightPassing(NamedTuple):
    """A passing: the robot's center came below the goal's light `number`, from 1, `beyond_mm` ago.

    `valid` is True if the light was detected; `heading_error_deg` is the error of the reported heading, None
    if unknown; `measurement` comes from one image of the light; None if no image showed it.
    """

    number: int
    valid: bool
    beyond_mm: float
    heading_error_deg: float | None = None
    measurement: ProgressMeasurement | None = None


class _Stray(NamedTuple):
    place_mm: float
    times: int


@dataclass(frozen=True, slots=True, kw_only=True)
class LightTrack:
    """The progress of a goal, and the measurements by the next light.

    Attributes:
        reckoning: estimate of the progress, at the last light.
        passed: number of lights passed.
        measurements: measurements of the progress by images of the next light; once an image shows the
            light whole, only such images count.
        heading_errors_deg: measurements of the heading's error by the same images.
        seen_whole: True if an image showed the next light whole.
        dark_images: number of images that should have shown the next light and did not.
        relocation: measurement of a lost robot's progress by two lights, from the newest image.
        blind: True without a camera: lights are then passed by the progress alone.
    """

    goal: LightGoal
    reckoning: TrackEstimate
    passed: int = 0
    measurements: tuple[ProgressMeasurement, ...] = ()
    heading_errors_deg: tuple[float, ...] = ()
    seen_whole: bool = False
    dark_images: int = 0
    strays: tuple[_Stray, ...] = field(default=())
    relocation: ProgressMeasurement | None = None
    blind: bool = False

    @classmethod
    def start(
        cls, goal: LightGoal, scale: OdometryScale, passed: int = 0, *, blind: bool = False
    ) -> LightTrack:
        """Start at the beginning of a goal, or at one of its lights, with the known scale of the odometry."""
        at_mm = goal.lights_mm[passed - 1] if passed else 0.0
        return cls(goal=goal, reckoning=TrackEstimate(at_mm=at_mm, scale=scale), passed=passed, blind=blind)

    @property
    def done(self) -> bool:
        """True if all lights were passed."""
        return self.passed >= len(self.goal.lights_mm)

    def reckoned(self, progress_mm: float) -> TrackEstimate:
        """Return the estimate at a reported progress, updated with the measurements by the next light."""
        moved = self.reckoning.moved(progress_mm)
        if not self.measurements:
            return moved
        variance = LIGHT_SIGMA_MM**2 + DETECTION_SIGMA_MM**2 / len(self.measurements)
        return moved.updated(median(self.errors_mm), variance)

    @property
    def errors_mm(self) -> tuple[float, ...]:
        """Errors of the reported progress, by images of the next light."""
        return tuple(measurement.error_mm for measurement in self.measurements)

    def observed(self, detections: LightDetections) -> LightTrack:
        """Return the track after an image."""
        if self.done:
            return self
        reckoning = self.reckoning.moved(detections.progress_mm)
        track = self if self.relocation is None else replace(self, relocation=None)
        for light in detections.lights:
            track = track._with_light(light, detections, reckoning)
        ahead = self.goal.lights_mm[self.passed] - self.reckoned(detections.progress_mm).progress_mm
        is_aligned = abs(detections.tilt_deg) <= MAX_TILT_DEG
        if is_aligned and abs(ahead) <= _IN_VIEW_MM and track.measurements == self.measurements:
            track = replace(track, dark_images=track.dark_images + 1)
        return track

    def passing(self, progress_mm: float) -> tuple[LightTrack, LightPassing | None]:
        """Return the track, and the passing of the next light if the robot's center came below it."""
        if self.done:
            return self, None
        valid = self.seen_whole or len(self.measurements) > 1
        reckoning = self.reckoned(progress_mm) if valid else self.reckoning.moved(progress_mm)
        beyond = reckoning.progress_mm - self.goal.lights_mm[self.passed]
        if beyond < (0.0 if valid else self._undetected_margin(reckoning)):
            return self, None
        has_heading = len(self.heading_errors_deg) == _MAX_HEADING_ERRORS
        number = self.passed + 1
        track = replace(
            self,
            reckoning=reckoning,
            passed=number,
            measurements=(),
            heading_errors_deg=(),
            seen_whole=False,
            dark_images=0,
            strays=() if valid else self.strays,
        )
        heading_error_deg = median(self.heading_errors_deg) if has_heading else None
        return track, LightPassing(
            number, valid, beyond, heading_error_deg, self._median_measurement if valid else None
        )

    @property
    def _median_measurement(self) -> ProgressMeasurement:
        """The median measurement by images of the next light."""
        by_error = sorted(self.measurements, key=lambda measurement: measurement.error_mm)
        return by_error[len(by_error) // 2]

    def corrected(self, correction_mm: float) -> LightTrack:
        """Return the track after the reported progress was corrected by `correction_mm`."""
        return replace(
            self,
            reckoning=self.reckoning.corrected(correction_mm),
            measurements=tuple(s._replace(error_mm=s.error_mm - correction_mm) for s in self.measurements),
            strays=tuple(stray._replace(place_mm=stray.place_mm + correction_mm) for stray in self.strays),
        )

    def estimated(self, progress_mm: float, sigma_mm: float) -> LightTrack:
        """Return the track after the reported progress was corrected to an estimate of this accuracy.

        The estimate replaces the track's own estimate of the error.
        """
        corrected = self.corrected(self.reckoning.error_mm)
        return replace(corrected, reckoning=corrected.reckoning.moved(progress_mm).anchored(0.0, sigma_mm))

    def to_next(self, progress_mm: float) -> float | None:
        """Return the distance to the next light, in mm, or None if there is none."""
        if self.done:
            return None
        return self.goal.lights_mm[self.passed] - self.reckoned(progress_mm).progress_mm

    def _undetected_margin(self, reckoning: TrackEstimate) -> float:
        """Return the distance beyond an undetected light at which it counts as passed."""
        if self.blind:
            return 0.0
        in_view = _IN_VIEW_MM if self.dark_images >= _DARK_IMAGES else 0.0
        return max(0.0, tolerance_mm(reckoning, self.goal.lights_mm) - in_view)

    def _with_light(
        self, light: SeenLight, detections: LightDetections, reckoning: TrackEstimate
    ) -> LightTrack:
        """Return the track after one light of an image."""
        place = reckoning.progress_mm + light.ahead_mm
        lights = self.goal.lights_mm
        nearest = min(range(len(lights)), key=lambda i: abs(lights[i] - place))
        if abs(lights[nearest] - place) > tolerance_mm(reckoning, lights):
            return self._with_stray(light, detections)
        if nearest != self.passed:
            return self  # a light that was already passed, or one after the next
        if self.seen_whole and not light.whole:
            return self  # a partial light adds nothing to whole ones
        measurement = _measurement(
            detections, lights[nearest] - light.ahead_mm, math.hypot(LIGHT_SIGMA_MM, DETECTION_SIGMA_MM)
        )
        measurements = (
            (*self.measurements, measurement) if self.seen_whole or not light.whole else (measurement,)
        )
        errors = self.heading_errors_deg
        if light.tilt_deg is not None and light.whole:
            errors = (*errors, light.tilt_deg - detections.tilt_deg)
        return replace(
            self,
            measurements=measurements[-_MAX_ERRORS:],
            heading_errors_deg=errors[-_MAX_HEADING_ERRORS:],
            seen_whole=self.seen_whole or light.whole,
        )

    def _with_stray(self, light: SeenLight, detections: LightDetections) -> LightTrack:
        """Return the track after a stray light; a second one may relocate the robot."""
        if not light.whole:
            return self
        place = detections.progress_mm + light.ahead_mm
        strays = self.strays
        if strays and abs(strays[-1].place_mm - place) < _STRAY_MM:
            last = strays[-1]
            strays = (*strays[:-1], _Stray((last.place_mm + place) / 2.0, last.times + 1))
        else:
            strays = (*strays[-1:], _Stray(place, 1))
        error = _relocation_error(strays, self.goal.lights_mm)
        if error is None:
            return replace(self, strays=strays)
        anchored = self.reckoning.moved(detections.progress_mm).anchored(error, LOST_SIGMA_MM)
        relocation = _measurement(detections, detections.progress_mm + error, LOST_SIGMA_MM)
        return replace(
            self,
            reckoning=anchored,
            strays=(),
            measurements=(),
            seen_whole=False,
            dark_images=0,
            relocation=relocation,
        )


def _measurement(detections: LightDetections, place_mm: float, sigma_mm: float) -> ProgressMeasurement:
    return ProgressMeasurement(
        detections.t_ns, place_mm, place_mm - detections.progress_mm, detections.tilt_deg, sigma_mm
    )


def tolerance_mm(reckoning: TrackEstimate, lights_mm: Sequence[float]) -> float:
    """Return the maximum distance of a detected light from its position on the map."""
    spacings = [after - before for before, after in pairwise(lights_mm)]
    max_gate = min([_MAX_GATE_MM, *(_SPACING_FRACTION * spacing for spacing in spacings)])
    return min(max_gate, 3.0 * math.hypot(reckoning.sigma_mm, LIGHT_SIGMA_MM) + SLIP_MM)


def _relocation_error(strays: tuple[_Stray, ...], lights_mm: Sequence[float]) -> float | None:
    """Return the smallest error of the progress that explains two strays by lights of the map, or None."""
    if len(strays) < 2 or min(stray.times for stray in strays) < _STRAY_TIMES:
        return None
    first, second = (stray.place_mm for stray in strays)
    spacing = second - first
    errors = [
        b - second
        for a, b in combinations(lights_mm, 2)
        if abs((b - a) - spacing) <= _PAIR_MM + _PAIR_FRACTION * abs(spacing)
    ]
    smallest = min(errors, key=abs, default=math.inf)
    return smallest if abs(smallest) <= _MAX_GATE_MM else None


# --- track goals --------------------------------------------------------------------------------------
#
# CTracker's goals at DServer, which it takes when $TrackData is upped, and resumes after a restart.
#
# TrackStart holds the robot's position when a goal was taken, the reference of LightOffset. A tracker that
# finds the TrackStart of an interrupted one resumes with the lights that CeilingLight does not count yet.

_GOAL_VARIABLES = (GOAL_DISTANCE, LIGHT_OFFSET, GOAL_DIRECTION)


class UnfinishedGoal(NamedTuple):
    """An interrupted goal, and the number of its lights that were passed."""

    goal: LightGoal
    passed: int


def take_new_goal_signal() -> Generator[Step, Any, bool]:
    """Down $TrackData; return True if it was upped for a new goal."""
    return (yield from try_wait(TRACK_DATA, 0.0))


def take_goal() -> Generator[Step, Any, LightGoal]:
    """Take the goal that the Planner set, which begins at the robot's position; reset CeilingLight.

    Raises:
        ValueError: the number of offsets differs from the number of lights.
    """
    here = yield from do("RServer", robot.position())
    variables = yield from do("DServer", data.get_many(_GOAL_VARIABLES))
    goal = _goal(variables, here.x, here.y)
    if goal is None:
        raise ValueError(
            f"{GOAL_DISTANCE} is {variables[GOAL_DISTANCE]!r} and {LIGHT_OFFSET} "
            f"{variables[LIGHT_OFFSET]!r} when {TRACK_DATA} was upped; expected a list with an offset in mm "
            "for each light: set both before"
        )
    yield from do("DServer", data.set_many({CEILING_LIGHT: 0, TRACK_START: [here.x, here.y]}))
    return goal


def unfinished_goal() -> Generator[Step, Any, UnfinishedGoal | None]:
    """Return the goal of an interrupted tracker, or None if it was finished or abandoned."""
    variables = yield from read_variables(*_GOAL_VARIABLES, CEILING_LIGHT, TRACK_START)
    if variables is None or not variables[TRACK_START] or (yield from is_goal_abandoned()):
        return None
    goal = _goal(variables, *variables[TRACK_START])
    passed = int(variables[CEILING_LIGHT])
    if goal is None:
        return None
    if passed >= len(goal.lights_mm):
        yield from end_goal()  # possibly for the second time: the Planner discards duplicates
        return None
    return UnfinishedGoal(goal, passed)


def end_goal() -> Generator[Step, Any, None]:
    """Notify the Planner that the last light was passed; Overshoot must already be set."""
    yield from do("DServer", data.signal(END_L_MODE))
    yield from abandon_goal()


def abandon_goal() -> Generator[Step, Any, None]:
    """Clear TrackStart, so that the current goal is not resumed."""
    yield from do("DServer", data.set(TRACK_START, []))


def is_goal_abandoned() -> Generator[Step, Any, bool]:
    """Return True if the robot has a new goal of another kind: no client waits for these lights anymore.

    GoalType NONE only halts the robot.
    """
    variables = yield from read_variables(GOAL_TYPE)
    return variables is not None and variables[GOAL_TYPE] not in (GoalKind.LIGHTS, GoalKind.NONE)


def _goal(variables: dict[str, Any], x_mm: float, y_mm: float) -> LightGoal | None:
    count, offsets = variables[GOAL_DISTANCE], variables[LIGHT_OFFSET]
    if not isinstance(offsets, list) or len(offsets) != count:
        return None
    return LightGoal(
        direction_deg=float(variables[GOAL_DIRECTION]),
        x_mm=x_mm,
        y_mm=y_mm,
        lights_mm=tuple(accumulate(float(offset) for offset in offsets)),
    )
