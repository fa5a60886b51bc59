"""Compasses."""

from __future__ import annotations

import numpy as np

from colony.body import devices
from colony.ir.bearings import TURN
from colony.sim.chance import DEVICES, draw_deviates
from colony.sim.devices.device import Sensor
from colony.sim.physics import Physics


class Compass(Sensor):
    """The compass of robot number `robot`, which the building disturbs (`World.compass`)."""

    fields = ("heading",)

    def __init__(self, compass: devices.Compass, world: Physics, robot: int, *, seed: int) -> None:
        self._offset_deg, self._noise_deg = compass.offset_deg, compass.noise_deg
        self._world = world
        self._robot = robot
        self._seed = seed
        self._number = np.empty(1)

    def measure(self, field: str) -> float:
        """Return the heading, in [0, 360)."""
        draw_deviates(self._seed, DEVICES, self._world.elapsed_ns, self._number)
        error_deg = self._offset_deg + self._noise_deg * float(self._number[0])
        return (self._world.compass(self._robot) + error_deg) % TURN
