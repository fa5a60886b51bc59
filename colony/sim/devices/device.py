"""Simulated devices: what they measure at their rates, and the commands that they carry out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from colony.ir.types import ScalarValue, Value
from colony.runtime.protocol.messages import Sample
from colony.sim.devices.faults import FaultTimeline
from colony.sim.devices.measurements import Measurements
from colony.sim.given import Given, nothing_given
from colony.sim.mechanism import Action, Measurement, Mechanism
from colony.sim.physics import Physics


class SimulatedDevice(Protocol):
    """A device of a robot in a world. `now_ns` is the time that the world has reached, on the Clock."""

    def sense(self, now_ns: int) -> Mapping[str, Sample | None]:
        """Return all fields, with the time at which each was measured; None for one without a value."""
        ...

    def command(self, name: str, values: Mapping[str, ScalarValue], now_ns: int) -> None:
        """Carry out a command, with its parameters by name, after the delay of the robot's commands.

        Raises:
            ValueError: the device has no such command, or it cannot be carried out.
        """
        ...

    def safe(self, now_ns: int) -> None:
        """Make the device safe, after the same delay: whatever moves stops where it is."""
        ...


class Sensor:
    """What mechanisms have in common that measure at once and take no commands."""

    def measure(self, field: str) -> Value | None:
        """Return what a field reads; see `Mechanism`."""
        raise NotImplementedError

    def take(self, field: str) -> Measurement[Value | None]:
        """Take a measurement; see `Mechanism`."""
        value = self.measure(field)
        return lambda: value

    def action(self, name: str, values: Mapping[str, ScalarValue]) -> Action:
        """Raise ValueError: there are no commands."""
        raise ValueError(f"a sensor has no command `{name}`")

    def safe(self) -> None:
        """Do nothing: nothing moves."""


class MeasuringDevice:
    """A mechanism that measures at the rates of its fields. Stateful: the mechanism and its measurements.

    Args:
        server: the name of its server.
        mechanism: what it is.
        periods_ns: its fields, in order, with the period of each; None for one that is measured when it is
            read.
        world: the world.
        robot: the number of the robot.
        given: what fields read in place of what is measured.
        faults: the faults of its readings.
    """

    def __init__(
        self,
        server: str,
        mechanism: Mechanism,
        periods_ns: Mapping[str, int | None],
        world: Physics,
        robot: int,
        given: Given,
        *,
        faults: FaultTimeline | None = None,
    ) -> None:
        self._server = server
        self._mechanism = mechanism
        self._world = world
        self._robot = robot
        self._given = None if given is nothing_given else given
        measured = {field: period for field, period in periods_ns.items() if field in mechanism.fields}
        measurements = Measurements(mechanism.take, measured, world, robot, faults)
        self._arrived = measurements.arrived
        # With what is measured when it is read.
        self._fields = [
            (field, mechanism.measure if field in measured and field not in measurements.scheduled else None)
            for field in periods_ns
        ]

    def sense(self, now_ns: int) -> Mapping[str, Sample | None]:
        """Return all fields; see `SimulatedDevice`."""
        found: dict[str, Sample | None] = {}
        given, arrived = self._given, self._arrived
        for field, measure in self._fields:
            value = None if given is None else given(self._server, field, now_ns)
            taken_ns = now_ns
            if value is None:
                if measure is not None:
                    value = measure(field)
                elif field in arrived:
                    measurement, elapsed_ns = arrived[field]
                    value, taken_ns = measurement(), now_ns - self._world.elapsed_ns + elapsed_ns
            found[field] = None if value is None or value == "missing" else Sample(value, taken_ns)
        return found

    def command(self, name: str, values: Mapping[str, ScalarValue], now_ns: int) -> None:
        """Carry out a command; see `SimulatedDevice`."""
        self._world.carry_out(self._robot, self._mechanism.action(name, values))

    def safe(self, now_ns: int) -> None:
        """Make the device safe; see `SimulatedDevice`."""
        self._world.carry_out(self._robot, self._mechanism.safe)
