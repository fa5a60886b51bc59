"""Outputs, which stay as they are set."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from colony.body import devices
from colony.ir.types import ScalarValue
from colony.sim.devices.device import Sensor
from colony.sim.mechanism import Action


class Outputs(Sensor):
    """The outputs of a server, off at first. Stateful: holds what they were set to."""

    def __init__(self, output: devices.Output) -> None:
        self._off: dict[str, ScalarValue] = {
            name: False if kind == "on" else 0.0 for name, kind in output.outputs.items()
        }
        self._now = dict(self._off)
        self.fields = tuple(self._off)

    def measure(self, field: str) -> ScalarValue:
        """Return what an output is set to."""
        return self._now[field]

    def action(self, name: str, values: Mapping[str, ScalarValue]) -> Action:
        """Return what sets all outputs: those without a value are switched off, levels are within 0 and 1.

        Raises:
            ValueError: the command is not `set`, or there is no such output.
        """
        if name != "set":
            raise ValueError(f"outputs have no command `{name}`; they have `set`")
        unknown = next((value for value in values if value not in self._off), None)
        if unknown is not None:
            raise ValueError(f"there is no output `{unknown}`; there are {', '.join(self._off)}")
        return partial(self._set, {output: self._valid(output, values) for output in self._off})

    def safe(self) -> None:
        """Switch everything off."""
        self._set(self._off)

    def _valid(self, output: str, values: Mapping[str, ScalarValue]) -> ScalarValue:
        """Return the value of an output in a command, of its kind."""
        value = values.get(output, 0.0)
        return bool(value) if self._off[output] is False else min(max(float(value), 0.0), 1.0)

    def _set(self, values: Mapping[str, ScalarValue]) -> None:
        self._now = dict(values)
