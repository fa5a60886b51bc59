"""The actuator that a program binds to the base, or the built-in one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from colony.ir.program import Actuator, ActuatorField
from colony.ir.types import ScalarValue
from colony.runtime.arbitration.motion import Speeds
from colony.runtime.protocol.bindings import ActuatorBinding
from colony.runtime.protocol.deployment import ActuatorTable, Deployment, actuator_table, actuators_of
from colony.runtime.protocol.fields import RSERVER
from colony.runtime.servers.drivers import BaseLimits
from colony.runtime.servers.motion_commands import Range, full_range

FRAME_NS = 50_000_000
"""Frame period of a robot without a program, in nanoseconds."""

_DRIVE = RSERVER.commands[0]

_BUILT_IN = actuator_table(
    Actuator(
        name=_DRIVE.name,
        fields=tuple(ActuatorField(name=p.name, type=p.type) for p in _DRIVE.parameters),
        server=RSERVER.name,
        command=_DRIVE.name,
        idle=(0.0, 0.0),
    ),
    ActuatorBinding(actuator=_DRIVE.name, server=RSERVER.name, command=_DRIVE.name, places=(0, 1)),
    (),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseActuator:
    """The actuator of the base in a run, its range, and its clients by priority.

    `published` is True if its verdicts are published. It is False for a program that does not bind the base.
    """

    run: str
    frame_ns: int
    table: ActuatorTable
    allowed: Range
    clients: Mapping[int, str]
    published: bool = True
    lockstep: bool = False

    @property
    def name(self) -> str:
        """Name of the actuator."""
        return self.table.name

    def values(self, speeds: Speeds) -> tuple[float, ...]:
        """Return the values of the actuator for these speeds; a speed without a field is dropped."""
        values = [0.0] * len(self.table.fields)
        for i, speed in zip(self.table.places, speeds, strict=True):
            if i is not None:
                values[i] = speed
        return tuple(values)


def speeds_of(actuator: ActuatorTable, values: tuple[ScalarValue, ...]) -> Speeds:
    """Return the speeds of a command in base units; a missing parameter is 0."""
    velocity, turn = (0.0 if i is None else float(values[i]) for i in actuator.places)
    return Speeds(velocity, turn)


def base_actuator(deployed: Deployment | None, limits: BaseLimits) -> BaseActuator:
    """Return the actuator bound to the base in a valid deployment, else the built-in one."""
    if deployed is None:
        return BaseActuator(
            run="", frame_ns=FRAME_NS, table=_BUILT_IN, allowed=full_range(limits), clients={}
        )
    found = actuators_of(deployed, RSERVER.name)
    table = found[0] if found else _BUILT_IN
    return BaseActuator(
        run=deployed.run,
        frame_ns=deployed.frame_ns,
        table=table,
        allowed=_range(table, limits),
        clients={priority: name for name, priority in table.clients},
        published=bool(found),
        lockstep=deployed.lockstep,
    )


def mismatch(deployed: Deployment) -> str | None:
    """Return the reason why a deployment does not fit the base, or None."""
    return next(_mismatches(deployed), None)


def _mismatches(deployed: Deployment) -> Iterator[str]:
    if not deployed.run:
        yield "a run without a name"
    tables = [table for table in deployed.actuators if table.server == RSERVER.name]
    if len(tables) > 1:
        names = " and ".join(f"`{table.name}`" for table in tables)
        yield f"{names} command the base; expected one actuator"
    for table in tables:
        yield from _table_mismatches(table)


def _table_mismatches(table: ActuatorTable) -> Iterator[str]:
    if table.command != _DRIVE.name:
        yield f"`{table.name}`: {RSERVER.name} has no command `{table.command}`"
    count = len(table.fields)
    if len(table.places) != len(_DRIVE.parameters):
        yield f"`{table.name}`: {len(table.places)} parameters; expected {len(_DRIVE.parameters)}"
    if any(i is not None and not 0 <= i < count for i in table.places):
        yield f"`{table.name}`: a parameter is not one of its {count} fields"
    if any(field.kind != "number" for field in table.fields):
        yield f"`{table.name}`: a field is not a number"
    if any(not math.isfinite(field.factor) or field.factor == 0.0 for field in table.fields):
        yield f"`{table.name}`: a factor is 0 or not finite"
    if table.idle is not None and not all(map(_number, table.idle)):
        yield f"`{table.name}`: an idle command with a value that is not finite"
    priorities = [priority for _, priority in table.clients]
    if priorities != sorted(priorities, reverse=True):
        yield f"`{table.name}`: the clients are not in the order of their priorities"


def _number(value: ScalarValue) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _range(table: ActuatorTable, limits: BaseLimits) -> Range:
    """Return the program's range within the limits of the base; a speed that it lacks keeps its limits."""
    whole = full_range(limits)
    velocity, turn = table.places
    return whole._replace(
        velocity=_narrowed(whole.velocity, table, velocity), turn=_narrowed(whole.turn, table, turn)
    )


def _narrowed(whole: tuple[float, float], table: ActuatorTable, place: int | None) -> tuple[float, float]:
    if place is None:
        return whole
    field = table.fields[place]
    low = whole[0] if field.low is None else max(whole[0], field.low)
    high = whole[1] if field.high is None else min(whole[1], field.high)
    return (low, high)
