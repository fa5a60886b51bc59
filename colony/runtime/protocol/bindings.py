"""Binding of a program's sensors and actuators to the servers of a robot, checked before anything moves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from colony.execute.intake import converted
from colony.ir.fitting import command_named, misfits
from colony.ir.program import TUNABLE_SERVER, Actuator, Robot, Sensor
from colony.ir.servers import COMMON_SERVERS, ServerSpec
from colony.ir.types import Value
from colony.text.diagnostics import DiagnosticError


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorBinding:
    """The binding of a sensor to `field` of `server`.

    `factor` is the declared unit in base units. The server sends base units or, if `declared`, values in the
    sensor's declared unit. That is so for DServer's variables and for tunable params, which users set in that
    unit. `server` of a tunable param is the Clock: ticks have its value.
    `sent` is true for what an actuator was given in the frame before.
    """

    sensor: str
    server: str
    field: str
    max_age_ns: int | None
    factor: float = 1.0
    declared: bool = False
    sent: bool = False

    def is_fresh(self, taken_ns: int, now_ns: int) -> bool:
        """Return True if a value taken at `taken_ns` is not too old at `now_ns`."""
        return self.max_age_ns is None or now_ns - taken_ns <= self.max_age_ns

    def in_base_units(self, value: Value) -> Value:
        """Return the value that an executor computes with, for a value sent by the server.

        Recordings contain readings in the declared unit. So a value from hardware is converted to that unit
        and back: then it equals, with the same rounding, the value that a replay computes.
        """
        factor = self.factor
        if factor == 1.0:
            return value
        if self.declared:
            return converted(value, lambda x: x * factor)  # type: ignore[return-value]
        return converted(value, lambda x: x / factor * factor)  # type: ignore[return-value]

    def in_declared_units(self, value: Value) -> Value:
        """Return a value of the server in the declared unit, for display."""
        factor = self.factor
        if factor == 1.0 or self.declared:
            return value
        return converted(value, lambda x: x / factor)  # type: ignore[return-value]


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorBinding:
    """The binding of an actuator to `command` of `server`.

    `field_indices[i]` is the index of the actuator's field for parameter i of the command, None if that
    parameter is always 0; `field_indices` is empty if the server takes the fields as they are.
    """

    actuator: str
    server: str
    command: str
    field_indices: tuple[int | None, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Bindings:
    """The bindings of all sensors and actuators of a program, in the order declared."""

    sensors: tuple[SensorBinding, ...]
    actuators: tuple[ActuatorBinding, ...]


def bound_servers(robot: Robot) -> tuple[str, ...]:
    """Return the servers of sensors and actuators that not every robot has."""
    common = {TUNABLE_SERVER, *(server.name for server in COMMON_SERVERS)}
    bound = (*(s.server for s in robot.sensors), *(a.server for a in robot.actuators))
    return tuple(dict.fromkeys(server for server in bound if server not in common))


def bind(robot: Robot, servers: tuple[ServerSpec, ...]) -> Bindings:
    """Find each sensor's field and each actuator's command among `servers`.

    Raises:
        DiagnosticError: a sensor or actuator does not fit; every mismatch is reported at its declaration.
    """
    diagnostics = list(misfits(robot, servers))
    if diagnostics:
        raise DiagnosticError(diagnostics)
    by_name = {server.name: server for server in servers}
    return Bindings(
        sensors=tuple(_bind_sensor(s, by_name) for s in robot.sensors),
        actuators=tuple(_bind_actuator(a, by_name[a.server]) for a in robot.actuators),
    )


def _bind_sensor(sensor: Sensor, servers: Mapping[str, ServerSpec]) -> SensorBinding:
    is_sent = sensor.sent is not None
    return SensorBinding(
        sensor=sensor.name,
        server=sensor.server,
        field=sensor.field,
        max_age_ns=None if is_sent else sensor.within_ns,
        factor=sensor.factor,
        declared=sensor.tunable or (not is_sent and servers[sensor.server].accepts_any_name),
        sent=is_sent,
    )


def _bind_actuator(actuator: Actuator, server: ServerSpec) -> ActuatorBinding:
    command = None if server.accepts_any_name else command_named(actuator.command, server)
    names = [f.name for f in actuator.fields]
    parameters = () if command is None else command.parameters
    return ActuatorBinding(
        actuator=actuator.name,
        server=server.name,
        command=actuator.command,
        field_indices=tuple(names.index(p.name) if p.name in names else None for p in parameters),
    )
