"""The actuators that a server has by itself: connections command them while no program has its own."""

from __future__ import annotations

from colony.ir.program import Actuator, ActuatorField
from colony.ir.servers import CommandSpec
from colony.ir.types import ScalarValue
from colony.runtime.protocol.bindings import ActuatorBinding
from colony.runtime.protocol.deployment import ActuatorSpec, actuator_spec


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
