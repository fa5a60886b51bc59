"""Single range finders."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from colony.body import devices
from colony.ir.types import Value
from colony.sim.devices.beams import DROPOUT_BITS, LidarModel, find_ranges, normal_quantiles
from colony.sim.devices.device import Sensor
from colony.sim.mechanism import Measurement
from colony.sim.physics import Physics
from colony.sim.world.world import Situation

RAY_STEP_DEG = 1.0
"""Largest angle between two rays of a cone."""


class RangeFinders(Sensor):
    """The range finders of robot number `robot`. Stateful: keeps the last ranges.

    They see walls, other robots and people, at any height, but not glass. One without an echo is infinite.

    Args:
        finder: the range finders.
        world: the world.
        robot: the number of the robot.
        seed: the seed of their noise.
    """

    def __init__(self, finder: devices.RangeFinder, world: Physics, robot: int, *, seed: int) -> None:
        self.fields = (finder.field,)
        half = math.radians(finder.half_beam_deg)
        count = 2 * math.ceil(finder.half_beam_deg / RAY_STEP_DEG) + 1
        offsets = np.linspace(-half, half, count)
        directions = [math.radians(pose.bearing_deg) + offsets for pose in finder.poses]
        rays = [row for angles in directions for row in (np.cos(angles), np.sin(angles), np.ones(count))]
        self._rays = np.array(rays)
        self._cones = np.array(
            [(pose.x_mm, pose.y_mm, angles[0]) for pose, angles in zip(finder.poses, directions, strict=True)]
        )
        self._model = LidarModel(
            u=0.0,
            v=0.0,
            first=0.0,
            density=(count - 1) / (2.0 * half) if count > 1 else 1.0,
            full_range=finder.range_mm,
            noise=finder.noise_mm,
            dropouts=round(finder.dropouts * 2**DROPOUT_BITS),
            person=world.person_radius_mm,
        )
        self._nearest = finder.nearest_mm
        self._noise_fraction = finder.noise_fraction
        self._quantiles = normal_quantiles()
        self._nearness = np.empty(count)
        self._ranges = np.empty(len(finder.poses))
        self._world = world
        self._robot = robot
        self._seed = seed
        self._last: tuple[Situation, int, Value] | None = None

    def measure(self, field: str) -> Value:
        """Return the ranges now."""
        return self._find(self._world.situation(), self._world.elapsed_ns)

    def take(self, field: str) -> Measurement[Value]:
        """Take a measurement of the ranges; the rays are cast when the value is needed."""
        return partial(self._find, self._world.situation(), self._world.elapsed_ns)

    def _find(self, situation: Situation, event: int) -> Value:
        last = self._last
        if last is not None and last[0] is situation and last[1] == event:
            return last[2]
        find_ranges(
            situation.poses,
            situation.radii,
            situation.people,
            situation.walls,
            situation.boxes,
            self._robot,
            event,
            self._seed,
            self._model,
            self._nearest,
            self._noise_fraction,
            self._cones,
            self._rays,
            self._quantiles,
            self._nearness,
            self._ranges,
        )
        value: Value = tuple(self._ranges.tolist())
        self._last = (situation, event, value)
        return value
