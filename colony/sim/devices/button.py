"""Buttons that nobody presses: what presses them is given."""

from __future__ import annotations

from colony.body.devices import Button
from colony.sim.devices.device import Sensor


class Buttons(Sensor):
    """The buttons of a panel, all released."""

    def __init__(self, button: Button) -> None:
        self.fields = button.names

    def measure(self, field: str) -> bool:
        """Return False: the button is released."""
        return False
