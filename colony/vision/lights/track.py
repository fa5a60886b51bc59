"""The count of a corridor's ceiling lights, and the robot's place that follows from it (thesis section 5.6).

The map gives the places of the lights along the way. A light that the camera sees is *valid* if its place, by
the robot's progress and by its distance ahead, agrees with one of the map. The tolerance is 3 standard
deviations of the robot's place, which grow with the way since the last valid light, plus the loss of a
slipping wheel; it is always less than half of the way from light to light, so that two are never confused.

A light counts when the robot's center is below it. One that is out is passed by dead reckoning, when the
robot is beyond all places where it could be, save those that the camera has in view and finds dark.

Lights where none is expected are strays: a reflection, or the robot is lost. When two strays in a row are as
far apart as two lights of the map, that decides: the robot is lost, and knows where it is again.

A light's observation of the robot's place is a `Sighting`, from one image and by that alone: the pose
estimator fuses it with its other sources, and must not count anything twice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, pairwise
from statistics import median
from typing import NamedTuple

from colony.vision.lights.along_track import Reckoning, Scale
from colony.vision.lights.scan_lines import STEEPEST_DEG, Light

LIGHT_SIGMA_MM = 20.0
"""Standard deviation of a light's place on the map."""

SEEN_SIGMA_MM = 15.0
"""Standard deviation of a light's distance in one image: pixels, and the time from image to odometry."""

SLIP_MM = 160.0
"""Distance lost by two slips of the wheels."""

_IN_VIEW_MM = 420.0  # a light whose center is no further ahead or behind is wholly in view
_DARK_LOOKS = 3  # how many looks that find no light show that it is out
_SPACING_PART = 0.45
_MOST_ERRORS, _MOST_TURNS = 5, 3  # only the newest count: others correct the position in between, too
_STRAY_MM = 200.0
_STRAY_TIMES = 2
_PAIR_MM, _PAIR_PART = 120.0, 0.03
LOST_SIGMA_MM = 60.0
"""Standard deviation of a lost robot's place after two lights."""

_WIDEST_MM = 2_500.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LightGoal:
    """A way along `direction_deg` (0 north, 90 west) from a point in mm, below lights at these distances."""

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
        """Return a heading less the direction, in degrees counterclockwise, from -180 to 180."""
        return math.remainder(heading_deg - self.direction_deg, 360.0)


class Seen(NamedTuple):
    """The lights in an image, and the robot's reported progress and tilt and the time when it was taken."""

    lights: tuple[Light, ...]
    progress_mm: float
    tilt_deg: float
    t_ns: int = 0


class Sighting(NamedTuple):
    """An observation by one image: the robot's true progress when it was taken, by a light at a known place.

    `error_mm` is how far the reported progress was short of that, `tilt_deg` the reported tilt, and
    `sigma_mm` the standard deviation of the place.
    """

    t_ns: int
    place_mm: float
    error_mm: float
    tilt_deg: float
    sigma_mm: float


class Passing(NamedTuple):
    """The robot's center came below a light: the `number`th of its goal, from 1, `beyond_mm` ago.

    `valid` says that the light was seen; `turned_deg` is the error of the reported heading, None if unknown;
    `sighting` is the light's observation by one image, None if there is none.
    """

    number: int
    valid: bool
    beyond_mm: float
    turned_deg: float | None = None
    sighting: Sighting | None = None


class _Stray(NamedTuple):
    place_mm: float
    times: int


@dataclass(frozen=True, slots=True, kw_only=True)
class LightTrack:
    """The progress of a goal, and the observations of the light that comes next.

    Attributes:
        reckoning: estimate of the progress, at the last light.
        passed: number of lights passed.
        sightings: observations of the progress by images of the next light; only by those that show it whole,
            once there is one.
        turned_deg: their observations of the error of the heading.
        sure: an image showed the next light whole.
        dark_looks: number of images that should have shown it, and did not.
        found: the progress of a lost robot by two lights, from the newest image.
        blind: no image will ever show a light: they are passed by the progress alone.
    """

    goal: LightGoal
    reckoning: Reckoning
    passed: int = 0
    sightings: tuple[Sighting, ...] = ()
    turned_deg: tuple[float, ...] = ()
    sure: bool = False
    dark_looks: int = 0
    strays: tuple[_Stray, ...] = field(default=())
    found: Sighting | None = None
    blind: bool = False

    @classmethod
    def start(cls, goal: LightGoal, scale: Scale, passed: int = 0, *, blind: bool = False) -> LightTrack:
        """Start at the beginning of a goal, or at one of its lights, with the known scale of the odometry."""
        at_mm = goal.lights_mm[passed - 1] if passed else 0.0
        return cls(goal=goal, reckoning=Reckoning(at_mm=at_mm, scale=scale), passed=passed, blind=blind)

    @property
    def done(self) -> bool:
        """All lights were passed."""
        return self.passed >= len(self.goal.lights_mm)

    def reckoned(self, progress_mm: float) -> Reckoning:
        """Return the estimate at this reported progress, with the observations of the next light."""
        moved = self.reckoning.moved(progress_mm)
        if not self.sightings:
            return moved
        variance = LIGHT_SIGMA_MM**2 + SEEN_SIGMA_MM**2 / len(self.sightings)
        return moved.fixed(median(self.errors_mm), variance)

    @property
    def errors_mm(self) -> tuple[float, ...]:
        """Errors of the reported progress, by images of the next light."""
        return tuple(sighting.error_mm for sighting in self.sightings)

    def seen(self, seen: Seen) -> LightTrack:
        """Return the track after an image."""
        if self.done:
            return self
        reckoning = self.reckoning.moved(seen.progress_mm)
        track = self if self.found is None else replace(self, found=None)
        for light in seen.lights:
            track = track._with(light, seen, reckoning)
        ahead = self.goal.lights_mm[self.passed] - self.reckoned(seen.progress_mm).progress_mm
        upright = abs(seen.tilt_deg) <= STEEPEST_DEG
        if upright and abs(ahead) <= _IN_VIEW_MM and track.sightings == self.sightings:
            track = replace(track, dark_looks=track.dark_looks + 1)
        return track

    def passing(self, progress_mm: float) -> tuple[LightTrack, Passing | None]:
        """Return the track, and the light that the robot's center came below, if it did."""
        if self.done:
            return self, None
        valid = self.sure or len(self.sightings) > 1
        reckoning = self.reckoned(progress_mm) if valid else self.reckoning.moved(progress_mm)
        beyond = reckoning.progress_mm - self.goal.lights_mm[self.passed]
        if beyond < (0.0 if valid else self._dark_way(reckoning)):
            return self, None
        told = len(self.turned_deg) == _MOST_TURNS
        number = self.passed + 1
        track = replace(
            self,
            reckoning=reckoning,
            passed=number,
            sightings=(),
            turned_deg=(),
            sure=False,
            dark_looks=0,
            strays=() if valid else self.strays,
        )
        turned = median(self.turned_deg) if told else None
        return track, Passing(number, valid, beyond, turned, self._sighting if valid else None)

    @property
    def _sighting(self) -> Sighting:
        """The middle one of what images of the next light said."""
        by_error = sorted(self.sightings, key=lambda sighting: sighting.error_mm)
        return by_error[len(by_error) // 2]

    def told(self, correction_mm: float) -> LightTrack:
        """Return the track after the reported progress was corrected by `correction_mm`."""
        return replace(
            self,
            reckoning=self.reckoning.told(correction_mm),
            sightings=tuple(s._replace(error_mm=s.error_mm - correction_mm) for s in self.sightings),
            strays=tuple(stray._replace(place_mm=stray.place_mm + correction_mm) for stray in self.strays),
        )

    def estimated(self, progress_mm: float, sigma_mm: float) -> LightTrack:
        """Return the track after the reported progress was corrected to an estimate of this accuracy.

        What was known here of its error is in that.
        """
        told = self.told(self.reckoning.error_mm)
        return replace(told, reckoning=told.reckoning.moved(progress_mm).anchored(0.0, sigma_mm))

    def to_next(self, progress_mm: float) -> float | None:
        """Return the distance to the next light, in mm, or None if there is none."""
        if self.done:
            return None
        return self.goal.lights_mm[self.passed] - self.reckoned(progress_mm).progress_mm

    def _dark_way(self, reckoning: Reckoning) -> float:
        """Return how far beyond the place of an unseen light the robot must be."""
        if self.blind:
            return 0.0
        in_view = _IN_VIEW_MM if self.dark_looks >= _DARK_LOOKS else 0.0
        return max(0.0, tolerance_mm(reckoning, self.goal.lights_mm) - in_view)

    def _with(self, light: Light, seen: Seen, reckoning: Reckoning) -> LightTrack:
        """Return the track after one light of an image."""
        place = reckoning.progress_mm + light.ahead_mm
        lights = self.goal.lights_mm
        nearest = min(range(len(lights)), key=lambda i: abs(lights[i] - place))
        if abs(lights[nearest] - place) > tolerance_mm(reckoning, lights):
            return self._with_stray(light, seen)
        if nearest != self.passed:
            return self  # one that was passed already, or one of which there is time to think later
        if self.sure and not light.whole:
            return self  # half a light adds nothing to what was seen whole
        sighting = _sighting(
            seen, lights[nearest] - light.ahead_mm, math.hypot(LIGHT_SIGMA_MM, SEEN_SIGMA_MM)
        )
        sightings = (*self.sightings, sighting) if self.sure or not light.whole else (sighting,)
        turned = self.turned_deg
        if light.tilt_deg is not None and light.whole:
            turned = (*turned, light.tilt_deg - seen.tilt_deg)
        return replace(
            self,
            sightings=sightings[-_MOST_ERRORS:],
            turned_deg=turned[-_MOST_TURNS:],
            sure=self.sure or light.whole,
        )

    def _with_stray(self, light: Light, seen: Seen) -> LightTrack:
        """Return the track after a light where none is expected; at the second one it is found again."""
        if not light.whole:
            return self
        place = seen.progress_mm + light.ahead_mm
        strays = self.strays
        if strays and abs(strays[-1].place_mm - place) < _STRAY_MM:
            last = strays[-1]
            strays = (*strays[:-1], _Stray((last.place_mm + place) / 2.0, last.times + 1))
        else:
            strays = (*strays[-1:], _Stray(place, 1))
        error = _lost_by(strays, self.goal.lights_mm)
        if error is None:
            return replace(self, strays=strays)
        anchored = self.reckoning.moved(seen.progress_mm).anchored(error, LOST_SIGMA_MM)
        found = _sighting(seen, seen.progress_mm + error, LOST_SIGMA_MM)
        return replace(
            self, reckoning=anchored, strays=(), sightings=(), sure=False, dark_looks=0, found=found
        )


def _sighting(seen: Seen, place_mm: float, sigma_mm: float) -> Sighting:
    return Sighting(seen.t_ns, place_mm, place_mm - seen.progress_mm, seen.tilt_deg, sigma_mm)


def tolerance_mm(reckoning: Reckoning, lights_mm: Sequence[float]) -> float:
    """Return how far a light may be from its place in the map, to be that one."""
    spacings = [after - before for before, after in pairwise(lights_mm)]
    most = min([_WIDEST_MM, *(_SPACING_PART * spacing for spacing in spacings)])
    return min(most, 3.0 * math.hypot(reckoning.sigma_mm, LIGHT_SIGMA_MM) + SLIP_MM)


def _lost_by(strays: tuple[_Stray, ...], lights_mm: Sequence[float]) -> float | None:
    """Return the least error of the progress by which two strays are two lights; None if there is none."""
    if len(strays) < 2 or min(stray.times for stray in strays) < _STRAY_TIMES:
        return None
    first, second = (stray.place_mm for stray in strays)
    apart = second - first
    errors = [
        b - second
        for a, b in combinations(lights_mm, 2)
        if abs((b - a) - apart) <= _PAIR_MM + _PAIR_PART * abs(apart)
    ]
    least = min(errors, key=abs, default=math.inf)
    return least if abs(least) <= _WIDEST_MM else None
