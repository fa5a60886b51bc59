"""Counting ceiling lights as printed (thesis section 5.6): transitions from no light to light, each verified
by the distance from the light before.

What the thesis leaves open is where in an image a light counts, how far the distance may be off, and what
becomes of a light that was missed. Here there is light where the robot's center is below one and beyond its
middle, which is the place that the map knows: so what is left is an overshoot, as printed. The distance may
be off by a part of itself, and the next light that is seen counts for both, since the map knows that distance
too. Nothing passes a last light that is out, and nothing is corrected.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from colony.vision.lights.ceiling_camera import LIGHT_LENGTH_MM
from colony.vision.lights.track import LightGoal, Passing, Seen

TOLERANCE_MM = 600.0
"""How far the distance to the light before may be off in any case."""

TOLERANCE_PART = 0.1
"""Of the distance: how far it may be off beyond that."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ThesisTrack:
    """How far a goal is done.

    `since_mm` is the reported progress where the last valid light was detected, `light` that the last image
    showed one above the robot, `passed` how many lights count, `found` what the last image adds to that.
    """

    goal: LightGoal
    passed: int = 0
    since_mm: float = 0.0
    light: bool = False
    found: Passing | None = None

    @classmethod
    def start(cls, goal: LightGoal, passed: int = 0) -> ThesisTrack:
        """At the start of a goal, or at one of its lights."""
        return cls(goal=goal, passed=passed, since_mm=goal.lights_mm[passed - 1] if passed else 0.0)

    @property
    def done(self) -> bool:
        """All lights count as passed."""
        return self.passed >= len(self.goal.lights_mm)

    def seen(self, seen: Seen) -> ThesisTrack:
        """Return the track after an image."""
        above = [light for light in seen.lights if -LIGHT_LENGTH_MM / 2.0 <= light.ahead_mm <= 0.0]
        if not above or self.light or self.done:
            return replace(self, light=bool(above))
        place = seen.progress_mm + above[0].ahead_mm
        number = self._verified(place - self.since_mm)
        if number is None:
            return replace(self, light=True)
        return replace(self, light=True, since_mm=place, found=Passing(number, True, -above[0].ahead_mm))

    def passing(self, progress_mm: float) -> tuple[ThesisTrack, Passing | None]:
        """Return the track, and the light that was found last, once for each light."""
        if self.found is None:
            return self, None
        return replace(self, passed=self.found.number, found=None), self.found

    def to_next(self, progress_mm: float) -> float | None:
        """Not known: only images tell."""
        return None

    def _verified(self, distance_mm: float) -> int | None:
        """How many lights count, if the distance from the last one is that to one of the map."""
        before = self.goal.lights_mm[self.passed - 1] if self.passed else 0.0
        for index in range(self.passed, len(self.goal.lights_mm)):
            mapped = self.goal.lights_mm[index] - before
            if abs(distance_mm - mapped) <= TOLERANCE_MM + TOLERANCE_PART * mapped:
                return index + 1
        return None
