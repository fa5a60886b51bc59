"""Encoders of wheels: what the wheels report, which the world's dead reckoning is made of."""

from __future__ import annotations

import math

from colony.body import devices
from colony.sim.devices.device import Sensor
from colony.sim.physics import Physics


class Encoders(Sensor):
    """The encoders of the wheels of robot number `robot`, which are at 0 now."""

    fields = ("travel",)

    def __init__(self, encoders: devices.Encoders, world: Physics, robot: int) -> None:
        self._resolution_mm = encoders.resolution_mm
        self._world, self._robot = world, robot
        self._begin = world.travel(robot)

    def measure(self, field: str) -> tuple[float, ...]:
        """Return how far each wheel has rolled by its own report, in whole ticks."""
        rolled = zip(self._world.travel(self._robot), self._begin, strict=True)
        return tuple(self._in_ticks(now - begin) for now, begin in rolled)

    def _in_ticks(self, travel_mm: float) -> float:
        if self._resolution_mm == 0.0:
            return travel_mm
        return math.floor(travel_mm / self._resolution_mm) * self._resolution_mm
