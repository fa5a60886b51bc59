"""The servers of a robot, with the fields and commands that follow from its body and its interface."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

from colony.body.devices import Device, Directed
from colony.body.model import Body, ServerTable
from colony.body.ros2 import (
    Ros2Topic,
    action_of,
    field_topic,
    is_scan,
    parameter_path,
    path_of,
    unit_of,
)
from colony.ir.bearings import between
from colony.ir.program import Actuator, ActuatorField, Robot, Sensor
from colony.ir.ros2_messages import AUTO
from colony.ir.servers import COMMON_SERVERS, CommandSpec, FieldSpec, ParameterSpec, ServerSpec
from colony.ir.types import Array, Bool, Enum, Quantity, Scalar, Type, bearings_of, element_type, in_shape_of
from colony.text.units import Unit

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


def in_ros_units(spec: ServerSpec, server: ServerTable, robot: Robot) -> ServerSpec:
    """Return a server whose driver gives and takes numbers in the units of ROS, and others as declared."""
    declared = in_declared_units(spec, robot)
    fields = tuple(
        f
        if (unit := _unit(field_topic(server.ros2, f.name), f)) is None
        else replace(f, factor=float(unit.factor))
        for f in declared.fields
    )
    commands = tuple(
        replace(c, parameters=tuple(_in_ros_unit(p, server.ros2.get(c.name)) for p in c.parameters))
        for c in declared.commands
    )
    return replace(declared, fields=fields, commands=commands)


def _unit(topic: Ros2Topic | None, field: FieldSpec) -> Unit | None:
    is_number = isinstance(element_type(field.type), Quantity)
    return None if topic is None or not is_number else unit_of(topic, path_of(topic))


def _in_ros_unit(parameter: ParameterSpec, topic: Ros2Topic | None) -> ParameterSpec:
    if topic is None or not isinstance(parameter.type, Quantity):
        return parameter
    unit = unit_of(topic, parameter_path(topic, parameter.name))
    return parameter if unit is None else replace(parameter, factor=float(unit.factor))


def _server(name: str, body: Body, robot: Robot | None) -> ServerSpec:
    server, device = body.servers[name], body.device(name)
    sensors: dict[str, Sensor] = {}
    for sensor in () if robot is None else robot.sensors:
        if sensor.server == name and sensor.sent is None:
            sensors.setdefault(sensor.field, sensor)
    actuators = () if robot is None else (a for a in robot.actuators if a.server == name)
    return ServerSpec(
        name,
        fields=tuple(_fields(server, device, sensors)),
        commands=tuple(_commands(server, device, actuators)),
    )


def _fields(server: ServerTable, device: Device | None, sensors: Mapping[str, Sensor]) -> Iterator[FieldSpec]:
    """Yield the fields of the device, then those that the interface reads and only the table has."""
    measured = () if device is None else device.fields
    for spec in measured:
        yield _described(spec, server, sensors.get(spec.name))
    known = {spec.name for spec in measured}
    others = () if action_of(server.ros2) is None else sensors  # those without a topic are of the action
    for field in dict.fromkeys((*server.fields, *server.ros2, *others)):
        if field in known or (sensor := sensors.get(field)) is None:
            continue
        topic = field_topic(server.ros2, field)
        spec = FieldSpec(field, sensor.type, _DECLARED) if topic is None else _topic_field(topic, sensor)
        yield _described(spec, server, sensor)


def _topic_field(topic: Ros2Topic, sensor: Sensor) -> FieldSpec:
    """Return a field that a topic has, with the dimension of its message."""
    path = path_of(topic)
    element = _of_dimension(element_type(sensor.type), unit_of(topic, path))
    is_bare = is_scan(topic) and not isinstance(sensor.type, Array)
    type_: Type = Array(element, 1) if is_bare else in_shape_of(element, sensor.type)
    return FieldSpec(sensor.field, type_, f"`{path}` of {topic.type}")


def _of_dimension(declared: Scalar, unit: Unit | None) -> Scalar:
    """Return the type of a part of a message: as declared, but with the dimension of its unit."""
    if unit is None or isinstance(declared, Bool | Enum) or unit.dimension == declared.dimension:
        return declared
    return Quantity(unit.dimension)


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


def _commands(
    server: ServerTable, device: Device | None, actuators: Iterable[Actuator]
) -> Iterator[CommandSpec]:
    """Yield the commands of the device; without one, those that the interface gives."""
    if device is not None:
        yield from device.commands
        return
    for actuator in actuators:
        if server.ros2 and actuator.command not in server.ros2:
            continue
        topic = server.ros2.get(actuator.command)
        yield CommandSpec(actuator.command, tuple(_parameter(field, topic) for field in actuator.fields))


def _parameter(field: ActuatorField, topic: Ros2Topic | None) -> ParameterSpec:
    """Return a parameter as declared; of a topic, with the dimension of its message."""
    if topic is None:
        return ParameterSpec(field.name, field.type, _DECLARED, low=field.low, high=field.high)
    path = parameter_path(topic, field.name)
    type_ = _of_dimension(field.type, unit_of(topic, path))
    meaning = f"`{path}` of {'a twist' if topic.type == AUTO else topic.type}"
    return ParameterSpec(field.name, type_, meaning, low=field.low, high=field.high)
