"""The thesis's count of ceiling lights: each dark-to-bright change, verified by the distance (section 5.6).

The distance is that from the previous light. The thesis leaves open where in an image a light counts, how
large the error of the distance may be, and what happens after a missed light. Here a light counts when the
robot's center is below it and beyond its center, which is its position on the map; the distance beyond is the
overshoot, as printed. The tolerance of the distance grows with the distance. The light after a missed one
counts for both, as the map also has the distance between them. A last light that is out is never passed, and
nothing is corrected.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from colony.vision.lights.ceiling_camera import LIGHT_LENGTH_MM
from colony.vision.lights.track import (
    LightDetections,
    LightGoal,
    LightPassing,
    LightTrack,
    OdometryScale,
    TrackEstimate,
)

PERIOD_S = 0.5
"""Seconds between two images of the printed scripts."""

TOLERANCE_MM = 600.0
"""Tolerance of the distance from the previous light."""

TOLERANCE_FRACTION = 0.1
"""Additional tolerance, as a fraction of the distance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ThesisTrack(LightTrack):
    """The progress of a goal, as printed.

    Attributes:
        last_light_mm: the reported progress at the last valid light.
        light_above: True if the last image showed a light above the robot.
        new_passing: the passing detected in the last image.
    """

    last_light_mm: float = 0.0
    light_above: bool = False
    new_passing: LightPassing | None = None

    @classmethod
    def start(
        cls, goal: LightGoal, scale: OdometryScale, passed: int = 0, *, blind: bool = False
    ) -> ThesisTrack:
        """Start at the beginning of a goal, or at one of its lights."""
        at_mm = goal.lights_mm[passed - 1] if passed else 0.0
        reckoning = TrackEstimate(at_mm=at_mm, scale=scale)
        return cls(goal=goal, reckoning=reckoning, passed=passed, blind=blind, last_light_mm=at_mm)

    def observed(self, detections: LightDetections) -> ThesisTrack:
        """Return the track after an image."""
        above = [light for light in detections.lights if -LIGHT_LENGTH_MM / 2.0 <= light.ahead_mm <= 0.0]
        if not above or self.light_above or self.done:
            return replace(self, light_above=bool(above))
        place = detections.progress_mm + above[0].ahead_mm
        number = self._verified(place - self.last_light_mm)
        if number is None:
            return replace(self, light_above=True)
        return replace(
            self,
            light_above=True,
            last_light_mm=place,
            new_passing=LightPassing(number, True, -above[0].ahead_mm),
        )

    def passing(self, progress_mm: float) -> tuple[ThesisTrack, LightPassing | None]:
        """Return the track, and the passing of the last light, once for each light."""
        if self.new_passing is None:
            return self, None
        return replace(self, passed=self.new_passing.number, new_passing=None), self.new_passing

    def estimated(self, progress_mm: float, sigma_mm: float) -> ThesisTrack:
        """Return the same track: the uncertainty of the progress has no effect."""
        return self

    def to_next(self, progress_mm: float) -> float | None:
        """Return None: the next light is recognized only in images."""
        return None

    def _verified(self, distance_mm: float) -> int | None:
        """Return the number of lights passed, by the distance from the last one; None if no light fits."""
        before = self.goal.lights_mm[self.passed - 1] if self.passed else 0.0
        for index in range(self.passed, len(self.goal.lights_mm)):
            mapped = self.goal.lights_mm[index] - before
            if abs(distance_mm - mapped) <= TOLERANCE_MM + TOLERANCE_FRACTION * mapped:
                return index + 1
        return None
