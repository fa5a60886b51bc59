"""Bumpers by sectors of the hull."""

from __future__ import annotations

from colony.body import devices
from colony.ir.bearings import TURN, sweep
from colony.sim.devices.device import Sensor
from colony.sim.physics import Physics


class Bumper(Sensor):
    """The bumper of robot number `robot`, which walls, other robots and people press."""

    def __init__(self, bumper: devices.Bumper, world: Physics, robot: int) -> None:
        self.fields = (bumper.field,)
        self._sectors = [(first, float(sweep(first, last))) for first, last in bumper.sectors]
        self._free = (False,) * len(self._sectors)
        self._world = world
        self._robot = robot

    def measure(self, field: str) -> tuple[bool, ...]:
        """Return whether something touches the hull within each sector; its ends are in it."""
        touched = self._world.contact_bearings(self._robot)
        if not touched:
            return self._free
        return tuple(
            any((bearing - first) % TURN <= width for bearing in touched) for first, width in self._sectors
        )
