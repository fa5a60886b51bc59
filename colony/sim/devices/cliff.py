"""Sensors that look down: whether each is above a hole in the floor."""

from __future__ import annotations

import math

from colony.body import devices
from colony.sim.compiled import Floats2
from colony.sim.devices.device import Sensor
from colony.sim.physics import Physics


class Cliff(Sensor):
    """The sensors of robot number `robot` that look down."""

    def __init__(self, cliff: devices.Cliff, world: Physics, robot: int) -> None:
        self.fields = (cliff.field,)
        self._places = cliff.places
        self._solid = (False,) * len(cliff.places)
        self._world = world
        self._robot = robot

    def measure(self, field: str) -> tuple[bool, ...]:
        """Return whether the ground is missing at each place."""
        holes = self._world.holes
        if not holes:
            return self._solid
        x, y, heading = self._world.true_pose(self._robot)
        sine, cosine = math.sin(math.radians(heading)), math.cos(math.radians(heading))
        found = []
        for u, v in self._places:
            at_x, at_y = x - u * sine - v * cosine, y + u * cosine - v * sine
            found.append(any(is_inside(hole, at_x, at_y) for hole in holes))
        return tuple(found)


def is_inside(polygon: Floats2, x: float, y: float) -> bool:
    """Return True if a point is inside a polygon, (n, 2); a point on a side may be either.

    A ray from a point inside crosses the sides an odd number of times.
    """
    crossings = 0
    corners = polygon.tolist()
    for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            crossings += 1
    return crossings % 2 == 1
