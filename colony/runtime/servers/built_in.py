"""The actuators that a server has by itself: connections command them while no program has its own.

A program's actuator is held to the one that its command has by itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping

from colony.ir.program import Actuator, ActuatorField
from colony.ir.servers import CommandSpec
from colony.ir.types import ScalarValue
from colony.runtime.protocol.bindings import ActuatorBinding
from colony.runtime.protocol.deployment import ActuatorFieldSpec, ActuatorSpec, actuator_spec


def built_in_actuator(
    server: str, command: CommandSpec, *, idle: tuple[ScalarValue, ...] | None
) -> ActuatorSpec:
    """Return the actuator of a command, with the name, the parameters and the ranges of the command."""
    fields = tuple(
        ActuatorField(name=p.name, type=p.type, low=p.low, high=p.high) for p in command.parameters
    )
    return actuator_spec(
        Actuator(name=command.name, fields=fields, server=server, command=command.name, idle=idle),
        ActuatorBinding(
            actuator=command.name,
            server=server,
            command=command.name,
            field_indices=tuple(range(len(fields))),
        ),
        (),
    )


def expected_of(field: ActuatorFieldSpec, value: object) -> str | None:
    """Return what a field expects in place of a value, in base units; None if it takes the value."""
    if field.kind == "bool":
        return None if isinstance(value, bool) else "a bool"
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return "a finite number"
    if field.members:
        numbers = ", ".join(f"{member:g}" for member in field.members)
        return None if value in field.members else f"the number of a member: {numbers}"
    low, high = field.low, field.high
    if (low is None or value >= low) and (high is None or value <= high):
        return None
    return " to ".join("any" if bound is None else f"{bound:g}" for bound in (low, high))


def absent(parameter: ActuatorFieldSpec) -> ScalarValue:
    """Return the value of a parameter that an actuator does not declare."""
    return False if parameter.kind == "bool" else 0.0


def mismatch(server: str, built_in: Mapping[str, ActuatorSpec], specs: Iterable[ActuatorSpec]) -> str | None:
    """Return the reason why the actuators of a program do not fit a server's commands, or None.

    Args:
        server: the server's name.
        built_in: the server's own actuators, by command.
        specs: the program's actuators, each of this server.
    """
    return next(_mismatches(server, built_in, specs), None)


def _mismatches(
    server: str, built_in: Mapping[str, ActuatorSpec], specs: Iterable[ActuatorSpec]
) -> Iterator[str]:
    names: dict[str, str] = {}
    for spec in specs:
        own = built_in.get(spec.command)
        if own is None:
            yield f"`{spec.name}`: {server} has no command `{spec.command}`"
            continue
        if spec.command in names:
            found = f"`{names[spec.command]}` and `{spec.name}` command {server}.{spec.command}"
            yield f"{found}; expected one actuator"
        names[spec.command] = spec.name
        yield from _mismatches_of(spec, own)


def _mismatches_of(spec: ActuatorSpec, own: ActuatorSpec) -> Iterator[str]:
    count, parameters = len(spec.fields), own.fields
    if len(spec.field_indices) != len(parameters):
        yield f"`{spec.name}`: {len(spec.field_indices)} parameters; expected {len(parameters)}"
        return
    indices = tuple(zip(parameters, spec.field_indices, strict=True))
    for parameter, index in indices:
        if index is None:
            continue
        if not 0 <= index < count:
            yield f"`{spec.name}`: `{parameter.name}` is not one of its {count} fields"
            return
        if (spec.fields[index].kind == "bool") != (parameter.kind == "bool"):
            yield f"`{spec.name}`: `{parameter.name}` is a {spec.fields[index].kind}"
    if any(not math.isfinite(field.factor) or field.factor == 0.0 for field in spec.fields):
        yield f"`{spec.name}`: a factor is 0 or not finite"
    if spec.idle is not None and len(spec.idle) != count:
        yield f"`{spec.name}`: an idle command of {len(spec.idle)} values, not {count}"
        return
    for parameter, index in indices:
        if index is not None and spec.idle is None:
            continue
        value = absent(parameter) if index is None or spec.idle is None else spec.idle[index]
        if (expected := expected_of(parameter, value)) is not None:
            yield f"`{spec.name}`: {parameter.name} = {value!r} when idle; expected {expected}"
    priorities = [priority for _, priority in spec.clients]
    if priorities != sorted(priorities, reverse=True):
        yield f"`{spec.name}`: the clients are not in the order of their priorities"
