"""Values that a body describes: constants, noise, and what is painted over the map."""

from __future__ import annotations

import math

import numpy as np

from colony.body import devices
from colony.body.kinds import Amount
from colony.ir.types import ScalarValue
from colony.sim.chance import DEVICES, draw_deviates
from colony.sim.devices.device import Sensor
from colony.sim.physics import Physics


class Values(Sensor):
    """The described values where robot number `robot` is."""

    def __init__(self, described: devices.Values, world: Physics, robot: int, *, seed: int) -> None:
        self.fields = tuple(described.values)
        self._values = described.values
        self._world = world
        self._robot = robot
        self._seed = seed
        self._numbers = np.empty(len(self.fields))

    def measure(self, field: str) -> ScalarValue:
        """Return the value of a field at the robot's center."""
        described = self._values[field]
        x, y, _ = self._world.true_pose(self._robot)
        value = _plain(described, described.amount)
        for x0, y0, x1, y1, amount in described.rectangles:
            if min(x0, x1) <= x <= max(x0, x1) and min(y0, y1) <= y <= max(y0, y1):
                value = _plain(described, amount)
        around = value
        for circle in described.circles:
            away = math.hypot(x - circle.x_mm, y - circle.y_mm) / circle.radius_mm
            if away <= 1.0:
                value = _plain(described, circle.amount)
                if described.edge == "fading":
                    value += away * (around - value)
        if described.noise is not None:
            draw_deviates(self._seed, DEVICES, self._world.elapsed_ns, self._numbers)
            value += _plain(described, described.noise) * float(self._numbers[self.fields.index(field)])
        return value


def _plain(described: devices.ValueField, amount: Amount) -> ScalarValue:
    """Return an amount as a reading: a member of an enum as its number."""
    value = amount.value
    return float(described.members.index(value)) if isinstance(value, str) else value
