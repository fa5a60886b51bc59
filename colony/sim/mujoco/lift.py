"""Lifts: platforms that MuJoCo moves along a line."""

from __future__ import annotations

from collections.abc import Callable

from colony.body import devices
from colony.ir.types import Value
from colony.sim.devices.joint import Joint
from colony.sim.physics import Physics

RESOLUTION_MM = 1.0
"""Resolution of a lift's sensor, and the distance from its goal at which it has arrived."""


class Lift(Joint):
    """A joint along a line that follows its set point, where the motor lifts its load. Stateful, as `Joint`.

    Args:
        joint: the joint.
        world: the physics, for its time.
        position_mm: function that returns where the platform is.
    """

    def __init__(self, joint: devices.Joint, world: Physics, position_mm: Callable[[], float]) -> None:
        super().__init__(joint, world)
        self._ends = joint.ends
        self._position_mm = position_mm

    def setpoint_mm(self) -> float:
        """Return where the platform shall be now, on its way at the joint's speed."""
        return self._position()

    def measure(self, field: str) -> Value | None:
        """Return what a field reads: position and motion are those of the platform."""
        if field == "position":
            low, high = self._ends
            steps = round(self._position_mm() / RESOLUTION_MM)
            return min(max(steps * RESOLUTION_MM, low), high)
        if field == "moving":
            is_late = abs(self._position_mm() - self.setpoint_mm()) > RESOLUTION_MM
            return is_late or super().measure(field)
        return super().measure(field)
