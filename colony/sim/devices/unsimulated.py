"""Devices that exist in hardware alone: the simulator knows nothing of what they measure or do."""

from __future__ import annotations

from collections.abc import Mapping

from colony.ir.types import ScalarValue
from colony.sim.devices.device import Sensor
from colony.sim.mechanism import Action


class Unsimulated(Sensor):
    """A device whose fields have no values but those that are given; its commands do nothing."""

    fields = ()

    def measure(self, field: str) -> None:
        """Return None: there is nothing to measure."""

    def action(self, name: str, values: Mapping[str, ScalarValue]) -> Action:
        """Return what does nothing: any command is taken."""
        return self.safe
