"""Statistics of the detection of ceiling lights, by comparison with their known positions.

A light that is on is *in view* if its center is no more than `IN_VIEW_MM` ahead or behind, so that both of
its edges are in the image, the robot is below it, and its heading is no farther from the corridor's than the
detector allows. It is *passed* when the robot's center comes below its center, and *detected* if at least one
observation reported it while it was in view. A report farther than `MATCH_RADIUS_MM` from every light that is
on is *false*. Observations count only while the Navigator tracks lights; otherwise no client uses the ceiling
camera.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from colony.nav.maps.stickrep.geometry import direction
from colony.nav.maps.stickrep.model import Pose
from colony.sim.cameras.ceiling import LIGHT_ACROSS_MM
from colony.sim.hazards.scenery import CeilingLight
from colony.vision.lights.observing import CeilingObservation
from colony.vision.lights.scan_lines import MAX_TILT_DEG

IN_VIEW_MM = 420.0
"""Maximum distance ahead in mm of a light in view: the camera sees 779 mm, half a light is 300 mm."""

MATCH_RADIUS_MM = 150.0
"""Maximum distance of a reported light from a real one, along the corridor: a quarter of a light's length."""

_REACH_MM = 1100.0


class LightDetection(NamedTuple):
    """Counts of lights that are on, and of reports.

    Attributes:
        passed: number of lights passed.
        detected: number of those lights that were detected.
        in_view: number of pairs of an observation and a light in view.
        in_view_reported: number of these pairs in which the light was reported.
        reported: number of reports in all observations.
        false: number of false reports.
    """

    passed: int
    detected: int
    in_view: int
    in_view_reported: int
    reported: int
    false: int


class _Relative(NamedTuple):
    """A light relative to the robot.

    It has the distance ahead along the corridor, the distance to the left, and the robot's heading relative
    to the corridor.
    """

    ahead_mm: float
    left_mm: float
    turned_deg: float


@dataclass(slots=True)
class LightDetectionMonitor:
    """The counts of a run. Mutable.

    Attributes:
        lights: all lights of the ceiling, on or out.
    """

    lights: Sequence[CeilingLight]
    _ahead: dict[int, float] = field(default_factory=dict)
    _reported: set[int] = field(default_factory=set)
    _passed: set[int] = field(default_factory=set)
    _totals: list[int] = field(default_factory=lambda: [0, 0, 0, 0])

    def add_pose(self, pose: Pose) -> None:
        """Record the robot's pose while it tracks lights."""
        before, self._ahead = self._ahead, {}
        for number, light in self._nearby_lights(pose):
            relative = _relative(light, pose)
            if abs(relative.turned_deg) > MAX_TILT_DEG or abs(relative.left_mm) > LIGHT_ACROSS_MM / 2:
                continue
            self._ahead[number] = relative.ahead_mm
            if before.get(number, -1.0) > 0.0 >= relative.ahead_mm:
                self._passed.add(number)

    def add_observation(self, observation: CeilingObservation, pose: Pose) -> None:
        """Record the lights reported in an image that was taken at a pose."""
        near = [(number, _relative(light, pose)) for number, light in self._nearby_lights(pose)]
        in_view = {number: relative.ahead_mm for number, relative in near if _is_in_view(relative)}
        reported = {
            number
            for number, ahead_mm in in_view.items()
            if any(abs(report.ahead_mm - ahead_mm) <= MATCH_RADIUS_MM for report in observation.lights)
        }
        self._reported |= reported
        self._totals[0] += len(in_view)
        self._totals[1] += len(reported)
        self._totals[2] += len(observation.lights)
        self._totals[3] += sum(
            all(abs(report.ahead_mm - relative.ahead_mm) > MATCH_RADIUS_MM for _, relative in near)
            for report in observation.lights
        )

    @property
    def counts(self) -> LightDetection:
        """The counts so far."""
        return LightDetection(len(self._passed), len(self._passed & self._reported), *self._totals)

    @property
    def undetected(self) -> tuple[CeilingLight, ...]:
        """The lights that are on and were passed without being reported."""
        return tuple(self.lights[number] for number in sorted(self._passed - self._reported))

    def _nearby_lights(self, pose: Pose) -> list[tuple[int, CeilingLight]]:
        """Return the lights that are on and not far from the robot."""
        return [
            (number, light)
            for number, light in enumerate(self.lights)
            if light.brightness > 0.0
            and abs(light.x_mm - pose.x_mm) < _REACH_MM
            and abs(light.y_mm - pose.y_mm) < _REACH_MM
        ]


def _is_in_view(relative: _Relative) -> bool:
    return (
        abs(relative.ahead_mm) <= IN_VIEW_MM
        and abs(relative.left_mm) <= LIGHT_ACROSS_MM / 2
        and abs(relative.turned_deg) <= MAX_TILT_DEG
    )


def _relative(light: CeilingLight, pose: Pose) -> _Relative:
    """Return a light in the robot's frame, along the corridor in the robot's direction."""
    turned = math.remainder(pose.heading_deg - light.heading_deg, 180.0)
    unit = direction(pose.heading_deg - turned)
    dx, dy = light.x_mm - pose.x_mm, light.y_mm - pose.y_mm
    return _Relative(dx * unit.x + dy * unit.y, dy * unit.x - dx * unit.y, turned)
