"""The servers of a robot, with the fields and commands that follow from its body and its interface."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

from colony.body.devices import Device, Directed
from colony.body.model import Body, ServerTable
from colony.ir.bearings import between
from colony.ir.program import Actuator, Robot, Sensor
from colony.ir.servers import COMMON_SERVERS, CommandSpec, FieldSpec, ParameterSpec, ServerSpec
from colony.ir.types import bearings_of

_DECLARED = "the value that the interface declares"


def servers_of(body: Body, robot: Robot | None = None) -> tuple[ServerSpec, ...]:
    """Return what the servers of a robot offer: those of its body, and those that every robot has.

    What no device says of a field or command is as `robot`, the interface, declares it. Without
    one, only what devices say is returned.
    """
    described = (_server(name, body, robot) for name in body.servers)
    return (*described, *COMMON_SERVERS)


def in_declared_units(spec: ServerSpec, robot: Robot) -> ServerSpec:
    """Return a server whose driver gives and takes numbers in the units that the interface declares."""
    fields = {s.field: s.factor for s in reversed(robot.sensors) if s.server == spec.name and s.sent is None}
    parameters = {
        (actuator.command, field.name): field.factor
        for actuator in robot.actuators
        if actuator.server == spec.name
        for field in actuator.fields
    }
    bound = {actuator.command for actuator in robot.actuators if actuator.server == spec.name}
    return replace(
        spec,
        fields=tuple(
            replace(f, factor=fields.get(f.name, 1.0), is_read=f.name in fields) for f in spec.fields
        ),
        commands=tuple(
            replace(
                command,
                parameters=tuple(
                    replace(p, factor=parameters.get((command.name, p.name), 1.0)) for p in command.parameters
                ),
                is_bound=command.name in bound,
            )
            for command in spec.commands
        ),
    )


def _server(name: str, body: Body, robot: Robot | None) -> ServerSpec:
    server, device = body.servers[name], body.device(name)
    sensors: dict[str, Sensor] = {}
    for sensor in () if robot is None else robot.sensors:
        if sensor.server == name and sensor.sent is None:
            sensors.setdefault(sensor.field, sensor)
    actuators = () if robot is None else (a for a in robot.actuators if a.server == name)
    return ServerSpec(
        name, fields=tuple(_fields(server, device, sensors)), commands=tuple(_commands(device, actuators))
    )


def _fields(server: ServerTable, device: Device | None, sensors: Mapping[str, Sensor]) -> Iterator[FieldSpec]:
    """Yield the fields of the device, then those that the interface reads and only the table has."""
    measured = () if device is None else device.fields
    for spec in measured:
        yield _described(spec, server, sensors.get(spec.name))
    known = {spec.name for spec in measured}
    for field in server.fields:
        if field not in known and field in sensors:
            yield _described(FieldSpec(field, sensors[field].type, _DECLARED), server, sensors[field])


def _described(spec: FieldSpec, server: ServerTable, sensor: Sensor | None) -> FieldSpec:
    """Return a field with what the interface and the body say of it."""
    if sensor is not None:
        spec = replace(spec, declared=sensor.unit)
    own, device = server.fields.get(spec.name), server.simulated
    if own is None:
        return spec
    bearings = device.bearings() if isinstance(device, Directed) else None
    if bearings is None and sensor is not None:
        bearings = bearings_of(sensor.type)
    blocked: set[int] = set()
    for low, high in own.blocked if bearings is not None else ():
        blocked |= set(between(bearings, low, high))
    no_echo = spec.no_echo if own.no_echo_mm is None else own.no_echo_mm
    return replace(spec, no_echo=no_echo, hold=own.invalid == "hold", blocked=tuple(sorted(blocked)))


def _commands(device: Device | None, actuators: Iterable[Actuator]) -> Iterator[CommandSpec]:
    """Yield the commands of the device; without one, those that the interface gives."""
    if device is not None:
        yield from device.commands
        return
    for actuator in actuators:
        yield CommandSpec(actuator.command, tuple(_parameters(actuator)))


def _parameters(actuator: Actuator) -> Iterator[ParameterSpec]:
    for field in actuator.fields:
        yield ParameterSpec(field.name, field.type, _DECLARED, low=field.low, high=field.high)
