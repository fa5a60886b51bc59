"""What of a robot's declarations does not fit the servers that it names: fields, commands, types and ranges.

Programs are held to the servers of a body when they are checked, and to those that run when they are bound.

Codes: R001 no such server, R002 no such field, R003 a type that does not fit, R004 no such command, R005 no
such parameter, R006 two actuators on one command, R007 a sensor `within` a time that reads a field without an
age, R008 a range beyond that of the command.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from colony.ir.program import Actuator, ActuatorField, Robot, Sensor
from colony.ir.servers import RSERVER, SIDEWAYS_NAMES, CommandSpec, FieldSpec, ParameterSpec, ServerSpec
from colony.ir.types import DIMENSIONLESS, Array, Bool, Enum, Quantity, Scalar, Type, type_text
from colony.text.diagnostics import Diagnostic, error
from colony.text.units import NUMBER, readable_unit
from colony.text.wording import did_you_mean, duration_text, listed


def misfits(robot: Robot, servers: Sequence[ServerSpec]) -> Iterator[Diagnostic]:
    """Yield an error for each sensor and actuator that does not fit `servers`, at its declaration."""
    declarations: tuple[Sensor | Actuator, ...] = (*robot.sensors, *robot.actuators)
    for declared in declarations:
        yield from declaration_misfits(declared, servers)
    yield from shared_commands(robot.actuators)


def name_hint(name: str, available: Iterable[str]) -> str:
    """Return a hint with the available name closest to `name`; with all of them if none is close."""
    names = list(available)
    hint = did_you_mean(name, names)
    return hint or ("expected one of: " + ", ".join(names) if names else "there is none")


def _part_hint(name: str, server: str, available: Iterable[str]) -> str:
    """Return a hint for a field or parameter that a server does not have."""
    if server == RSERVER.name and name in SIDEWAYS_NAMES:
        return 'only a base whose body says `kind = "omnidirectional"` in `[body.drive]` drives sideways'
    return name_hint(name, available)


def server_named(name: str, servers: Iterable[ServerSpec]) -> ServerSpec | None:
    """Return the server of this name; None if there is none."""
    return next((server for server in servers if server.name == name), None)


def field_named(name: str, server: ServerSpec) -> FieldSpec | None:
    """Return the field of a server with this name; None if it has none."""
    return next((field for field in server.fields if field.name == name), None)


def command_named(name: str, server: ServerSpec) -> CommandSpec | None:
    """Return the command of a server with this name; None if it takes none."""
    return next((command for command in server.commands if command.name == name), None)


def declaration_misfits(declared: Sensor | Actuator, servers: Sequence[ServerSpec]) -> Iterator[Diagnostic]:
    """Yield the errors of a sensor or actuator that no server has like this."""
    if isinstance(declared, Sensor) and (declared.sent is not None or declared.tunable):
        return  # of an actuator, whose server is checked with it, or of a tick
    server = server_named(declared.server, servers)
    if server is None:
        hint = name_hint(declared.server, (s.name for s in servers))
        message = f"`{declared.name}`: there is no server `{declared.server}`"
        yield error("R001", declared.span, message, hint)
    elif server.accepts_any_name:
        return
    elif isinstance(declared, Sensor):
        yield from _sensor_misfit(declared, server)
    else:
        yield from _actuator_misfits(declared, server)


def _sensor_misfit(sensor: Sensor, server: ServerSpec) -> Iterator[Diagnostic]:
    spec = field_named(sensor.field, server)
    if spec is None:
        hint = _part_hint(sensor.field, server.name, (f.name for f in server.fields))
        message = f"`{sensor.name}`: {server.name} has no field `{sensor.field}`"
        yield error("R002", sensor.span, message, hint)
    elif not _sensor_fits(sensor.type, spec.type):
        found, expected = _type_texts(sensor.type, spec.type)
        message = f"`{sensor.name}`: {server.name}.{spec.name} is {expected}, not {found}"
        yield error("R003", sensor.span, message, f"it is {spec.meaning}" if spec.meaning else None)
    elif sensor.within_ns is not None and not spec.has_age:
        yield _ageless(sensor, sensor.within_ns, spec)


def _ageless(sensor: Sensor, within_ns: int, spec: FieldSpec) -> Diagnostic:
    where = f"{sensor.server}.{spec.name}"
    message = (
        f"`{sensor.name}` must be measured within {duration_text(within_ns)}, "
        f"but {where} does not say how old it is"
    )
    hint = "declare the field of the server with `has_age=True`, or leave out `within`"
    return error("R007", sensor.span, message, hint)


def _sensor_fits(declared: Type, provided: Type) -> bool:
    match declared, provided:
        case Array(element=wanted, size=n), Array(element=element, size=m):
            return n == m and fits(wanted, element)
        case (Bool() | Quantity() | Enum()) as wanted, (Bool() | Quantity() | Enum()) as element:
            return fits(wanted, element)
        case _:
            return False


def fits(wanted: Scalar, provided: Scalar) -> bool:
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


def _type_texts(declared: Type, provided: Type) -> tuple[str, str]:
    """Return both types as messages show them: enums of one name by their members."""
    if isinstance(declared, Enum) and isinstance(provided, Enum) and declared.name == provided.name:
        return f"an enum of {_members(declared)}", f"one of {_members(provided)}"
    return type_text(declared), type_text(provided)


def _members(enum: Enum) -> str:
    return ", ".join(f"{name} = {number:g}" for name, number in enum.members)


def _actuator_misfits(actuator: Actuator, server: ServerSpec) -> Iterator[Diagnostic]:
    command = command_named(actuator.command, server)
    if command is None:
        hint = name_hint(actuator.command, (c.name for c in server.commands))
        message = f"`{actuator.name}`: {server.name} has no command `{actuator.command}`"
        yield error("R004", actuator.span, message, hint)
        return
    parameters = {p.name: p for p in command.parameters}
    for field in actuator.fields:
        spec = parameters.get(field.name)
        if spec is None:
            message = (
                f"`{actuator.name}.{field.name}`: {actuator.server}.{command.name} takes no `{field.name}`"
            )
            yield error("R005", field.span, message, _part_hint(field.name, actuator.server, parameters))
        else:
            yield from _field_misfit(actuator, field, spec)
    declared = {field.name for field in actuator.fields}
    for spec in command.parameters:
        if spec.name not in declared and not _takes_zero(spec):
            message = (
                f"`{actuator.name}` has no field `{spec.name}`, which is then 0, "
                f"but the command takes {_range(spec)}"
            )
            yield error("R008", actuator.span, message, f"declare the field `{spec.name}`")


def _field_misfit(actuator: Actuator, field: ActuatorField, spec: ParameterSpec) -> Iterator[Diagnostic]:
    """Yield the error of a field of an actuator that the parameter of the command does not take."""
    name = f"`{actuator.name}.{field.name}`"
    if not fits(field.type, spec.type) or field.type == DIMENSIONLESS != spec.type:
        found, expected = _type_texts(field.type, spec.type)
        message = f"{name} is {found}, but the command takes {expected}"
        yield error("R003", field.span, message, _taken(spec))
    elif not _is_within(field.low, field.high, spec):
        found = _interval(field.low, field.high, field.type)
        message = f"{name} is {found}, but the command takes {_range(spec)}"
        yield error("R008", field.span, message, "declare its `range` within that")


def _taken(spec: ParameterSpec) -> str | None:
    """Return a hint at what a parameter is, None if nothing is known of it."""
    if isinstance(spec.type, Enum):
        return f"declare an enum with the members {_members(spec.type)}"
    return f"it is {spec.meaning}" if spec.meaning else None


def _range(spec: ParameterSpec) -> str:
    if isinstance(spec.type, Enum):
        return listed([f"{number:g}" for _, number in spec.type.members], "or")
    return _interval(spec.low, spec.high, spec.type)


def _interval(low: float | None, high: float | None, type_: Scalar) -> str:
    unit = ""
    if isinstance(type_, Quantity) and type_.dimension != NUMBER:
        shown = readable_unit(type_.dimension)
        unit = f" {shown.text}"
        low, high = (None if end is None else end / float(shown.factor) for end in (low, high))
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


def shared_commands(actuators: Iterable[Actuator]) -> Iterator[Diagnostic]:
    """Yield an error for each actuator whose command another one before it has."""
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
