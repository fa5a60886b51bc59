"""Binding of a program's sensors and actuators to the servers of a robot, checked before anything moves.

Codes: R001 no such server, R002 no such field, R003 a type that does not fit, R004 no such command, R005 no
such parameter, R006 two actuators on one command, R007 a sensor `within` a time that reads a field without an
age, R008 a range beyond that of the command.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from colony.execute.intake import converted
from colony.ir.program import Actuator, Robot, Sensor
from colony.ir.types import Array, Bool, Enum, Quantity, Scalar, Type, Value
from colony.runtime.protocol.fields import (
    SERVERS,
    CommandSpec,
    FieldSpec,
    ParameterSpec,
    ServerSpec,
)
from colony.text.diagnostics import Diagnostic, DiagnosticError, error
from colony.text.suggestions import did_you_mean
from colony.text.units import NUMBER
from colony.text.wording import duration_text, listed


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorBinding:
    """The binding of a sensor to `field` of `server`.

    `factor` is the declared unit in base units. The server sends base units or, if `declared`, values in the
    sensor's declared unit. That is so for DServer's variables, which users and programs set in that unit.
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


def bind(robot: Robot, servers: tuple[ServerSpec, ...] = SERVERS) -> Bindings:
    """Find each sensor's field and each actuator's command among `servers`.

    Raises:
        DiagnosticError: a sensor or actuator does not fit; every mismatch is reported at its declaration.
    """
    diagnostics: list[Diagnostic] = []
    sensors = [_bind_sensor(s, servers, diagnostics) for s in robot.sensors]
    actuators = [_bind_actuator(a, servers, diagnostics) for a in robot.actuators]
    diagnostics.extend(_shared_commands(robot.actuators))
    if diagnostics:
        raise DiagnosticError(diagnostics)
    return Bindings(
        sensors=tuple(s for s in sensors if s is not None),
        actuators=tuple(a for a in actuators if a is not None),
    )


def name_hint(name: str, available: Iterable[str]) -> str:
    """Return a hint with the available name closest to `name`; with all of them if none is close."""
    names = list(available)
    hint = did_you_mean(name, names)
    return hint or ("expected one of: " + ", ".join(names) if names else "there is none")


def _server(
    declared: Sensor | Actuator, servers: tuple[ServerSpec, ...], diagnostics: list[Diagnostic]
) -> ServerSpec | None:
    for server in servers:
        if server.name == declared.server:
            return server
    hint = name_hint(declared.server, (s.name for s in servers))
    diagnostics.append(
        error("R001", declared.span, f"`{declared.name}`: there is no server `{declared.server}`", hint)
    )
    return None


def _bind_sensor(
    sensor: Sensor, servers: tuple[ServerSpec, ...], diagnostics: list[Diagnostic]
) -> SensorBinding | None:
    if sensor.sent is not None:  # of an actuator, whose server is checked with it
        return SensorBinding(
            sensor=sensor.name,
            server=sensor.server,
            field=sensor.field,
            max_age_ns=None,
            factor=sensor.factor,
            sent=True,
        )
    server = _server(sensor, servers, diagnostics)
    if server is None:
        return None
    if not server.accepts_any_name:
        spec = next((f for f in server.fields if f.name == sensor.field), None)
        if spec is None:
            hint = name_hint(sensor.field, (f.name for f in server.fields))
            message = f"`{sensor.name}`: {server.name} has no field `{sensor.field}`"
            diagnostics.append(error("R002", sensor.span, message, hint))
            return None
        if not _sensor_fits(sensor.type, spec):
            message = f"`{sensor.name}`: {server.name}.{spec.name} is {spec.type}, not {sensor.type}"
            diagnostics.append(error("R003", sensor.span, message, f"it is {spec.meaning}"))
            return None
        if sensor.within_ns is not None and not spec.has_age:
            diagnostics.append(_ageless(sensor, spec))
            return None
    return SensorBinding(
        sensor=sensor.name,
        server=server.name,
        field=sensor.field,
        max_age_ns=sensor.within_ns,
        factor=sensor.factor,
        declared=server.accepts_any_name,
    )


def _ageless(sensor: Sensor, spec: FieldSpec) -> Diagnostic:
    assert sensor.within_ns is not None
    where = f"{sensor.server}.{spec.name}"
    message = (
        f"`{sensor.name}` must be measured within {duration_text(sensor.within_ns)}, "
        f"but {where} does not say how old it is"
    )
    hint = "declare the field of the server with `has_age=True`, or leave out `within`"
    return error("R007", sensor.span, message, hint)


def _sensor_fits(declared: Type, spec: FieldSpec) -> bool:
    match declared, spec.type:
        case Array(element=wanted, size=n), Array(element=provided, size=m):
            return n == m and _fits(wanted, provided)
        case (Bool() | Quantity() | Enum()) as wanted, (Bool() | Quantity() | Enum()) as provided:
            return _fits(wanted, provided)
        case _:
            return False


def _fits(wanted: Scalar, provided: Scalar) -> bool:
    """Return True if the types are equal, or if a plain number is wanted from a quantity.

    Any quantity can be read as a plain number, which is its value in base units. Enums are equal if their
    members are.
    """
    match wanted, provided:
        case Quantity(dimension=a), Quantity(dimension=b):
            return a in (b, NUMBER)
        case Bool(), Bool():
            return True
        case Enum(members=a_members), Enum(members=b_members):
            return set(a_members) == set(b_members)
        case _:
            return False


def _bind_actuator(
    actuator: Actuator, servers: tuple[ServerSpec, ...], diagnostics: list[Diagnostic]
) -> ActuatorBinding | None:
    server = _server(actuator, servers, diagnostics)
    if server is None:
        return None
    field_indices: tuple[int | None, ...] = ()
    if not server.accepts_any_name:
        command = next((c for c in server.commands if c.name == actuator.command), None)
        if command is None:
            hint = name_hint(actuator.command, (c.name for c in server.commands))
            message = f"`{actuator.name}`: {server.name} has no command `{actuator.command}`"
            diagnostics.append(error("R004", actuator.span, message, hint))
            return None
        before = len(diagnostics)
        _check_parameters(actuator, command, diagnostics)
        if len(diagnostics) > before:
            return None
        names = [f.name for f in actuator.fields]
        field_indices = tuple(names.index(p.name) if p.name in names else None for p in command.parameters)
    return ActuatorBinding(
        actuator=actuator.name, server=server.name, command=actuator.command, field_indices=field_indices
    )


def _check_parameters(actuator: Actuator, command: CommandSpec, diagnostics: list[Diagnostic]) -> None:
    parameters = {p.name: p for p in command.parameters}
    for field in actuator.fields:
        spec = parameters.get(field.name)
        if spec is None:
            message = (
                f"`{actuator.name}.{field.name}`: {actuator.server}.{command.name} takes no `{field.name}`"
            )
            diagnostics.append(error("R005", field.span, message, name_hint(field.name, parameters)))
        elif not _fits(field.type, spec.type):
            message = f"`{actuator.name}.{field.name}` is {field.type}, but the command takes {spec.type}"
            diagnostics.append(error("R003", field.span, message, _taken(spec)))
        elif not _is_within(field.low, field.high, spec):
            found = _interval(field.low, field.high, field.type)
            message = f"`{actuator.name}.{field.name}` is {found}, but the command takes {_range(spec)}"
            diagnostics.append(error("R008", field.span, message, "declare its `range` within that"))
    declared = {field.name for field in actuator.fields}
    for spec in command.parameters:
        if spec.name not in declared and not _takes_zero(spec):
            message = (
                f"`{actuator.name}` has no field `{spec.name}`, which is then 0, "
                f"but the command takes {_range(spec)}"
            )
            diagnostics.append(error("R008", actuator.span, message, f"declare the field `{spec.name}`"))


def _taken(spec: ParameterSpec) -> str | None:
    """Return a hint at what a parameter is, None if nothing is known of it."""
    if isinstance(spec.type, Enum):
        members = ", ".join(f"{name} = {number:g}" for name, number in spec.type.members)
        return f"declare an enum with the members {members}"
    return f"it is the {spec.meaning}" if spec.meaning else None


def _range(spec: ParameterSpec) -> str:
    if isinstance(spec.type, Enum):
        return listed([f"{number:g}" for _, number in spec.type.members], "or")
    return _interval(spec.low, spec.high, spec.type)


def _interval(low: float | None, high: float | None, type_: Scalar) -> str:
    unit = "" if str(type_) == "number" else f" {type_}"
    match low, high:
        case None, None:
            return "of any size"
        case None, _:
            return f"at most {high:g}{unit}"
        case _, None:
            return f"at least {low:g}{unit}"
        case _:
            return f"{low:g} to {high:g}{unit}"


def _is_within(low: float | None, high: float | None, spec: ParameterSpec) -> bool:
    """Return True if a range is within that of a parameter."""
    return (spec.low is None or (low is not None and low >= spec.low)) and (
        spec.high is None or (high is not None and high <= spec.high)
    )


def _takes_zero(spec: ParameterSpec) -> bool:
    if isinstance(spec.type, Enum):
        return any(number == 0.0 for _, number in spec.type.members)
    return _is_within(0.0, 0.0, spec)


def _shared_commands(actuators: tuple[Actuator, ...]) -> Iterable[Diagnostic]:
    owners: dict[tuple[str, str], str] = {}
    for actuator in actuators:
        first = owners.setdefault((actuator.server, actuator.command), actuator.name)
        if first != actuator.name:
            where = f"{actuator.server}.{actuator.command}"
            yield error(
                "R006",
                actuator.span,
                f"`{actuator.name}` and `{first}` both command {where}: nothing would arbitrate between them",
                "wire the modules of both to one actuator",
            )
