"""The actuator of a program that is bound to the base, or the built-in one if there is none."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from colony.ir.program import Actuator, ActuatorField
from colony.ir.types import ScalarValue
from colony.runtime.arbitration.motion import Speeds
from colony.runtime.protocol.bindings import ActuatorBinding
from colony.runtime.protocol.deployment import ActuatorTable, Deployment, actuator_table, commanded_by
from colony.runtime.protocol.fields import RSERVER
from colony.runtime.servers.drivers import BaseLimits
from colony.runtime.servers.orders import Range, whole_range

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

    `published`: verdicts are published. They are not for a program without the base, which does not know the
    actuator.
    """

    run: str
    frame_ns: int
    commanded: ActuatorTable
    allowed: Range
    places: Mapping[int, str]
    published: bool = True
    lockstep: bool = False

    @property
    def name(self) -> str:
        """Name of the actuator."""
        return self.commanded.name

    def values(self, speeds: Speeds) -> tuple[float, ...]:
        """Return speeds as values of the actuator; those that it has no field for are left out."""
        values = [0.0] * len(self.commanded.fields)
        for i, speed in zip(self.commanded.places, speeds, strict=True):
            if i is not None:
                values[i] = speed
        return tuple(values)


def speeds_of(actuator: ActuatorTable, values: tuple[ScalarValue, ...]) -> Speeds:
    """Return the speeds of a command in base units; a parameter that the actuator lacks is 0."""
    velocity, turn = (0.0 if i is None else float(values[i]) for i in actuator.places)
    return Speeds(velocity, turn)


def base_actuator(deployed: Deployment | None, limits: BaseLimits) -> BaseActuator:
    """Return the actuator bound to the base in a valid deployment, else the built-in one."""
    if deployed is None:
        return BaseActuator(
            run="", frame_ns=FRAME_NS, commanded=_BUILT_IN, allowed=whole_range(limits), places={}
        )
    found = commanded_by(deployed, RSERVER.name)
    commanded = found[0] if found else _BUILT_IN
    return BaseActuator(
        run=deployed.run,
        frame_ns=deployed.frame_ns,
        commanded=commanded,
        allowed=_range(commanded, limits),
        places={priority: name for name, priority in commanded.clients},
        published=bool(found),
        lockstep=deployed.lockstep,
    )


def misfit(deployed: Deployment) -> str | None:
    """Return the reason why a deployment does not fit the base, or None."""
    return next(_misfits(deployed), None)


def _misfits(deployed: Deployment) -> Iterator[str]:
    if not deployed.run:
        yield "a run without a name"
    tables = [table for table in deployed.actuators if table.server == RSERVER.name]
    if len(tables) > 1:
        names = " and ".join(f"`{table.name}`" for table in tables)
        yield f"{names} command the base; expected one actuator"
    for table in tables:
        yield from _misfits_of(table)


def _misfits_of(table: ActuatorTable) -> Iterator[str]:
    if table.command != _DRIVE.name:
        yield f"`{table.name}`: {RSERVER.name} has no command `{table.command}`"
    count = len(table.fields)
    if len(table.places) != len(_DRIVE.parameters):
        yield f"`{table.name}`: {len(table.places)} parameters; expected {len(_DRIVE.parameters)}"
    if any(i is not None and not 0 <= i < count for i in table.places):
        yield f"`{table.name}`: a parameter is none of its {count} fields"
    if any(field.kind != "number" for field in table.fields):
        yield f"`{table.name}`: a field is no number"
    if any(not math.isfinite(field.factor) or field.factor == 0.0 for field in table.fields):
        yield f"`{table.name}`: a factor is 0 or not finite"
    if table.idle is not None and not all(map(_number, table.idle)):
        yield f"`{table.name}`: an idle command that is not finite numbers"
    priorities = [priority for _, priority in table.clients]
    if priorities != sorted(priorities, reverse=True):
        yield f"`{table.name}`: clients that are not in the order of their priorities"


def _number(value: ScalarValue) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _range(commanded: ActuatorTable, limits: BaseLimits) -> Range:
    """Return the program's range within the limits of the base; a speed that it lacks keeps its limits."""
    whole = whole_range(limits)
    velocity, turn = commanded.places
    return whole._replace(
        velocity=_narrowed(whole.velocity, commanded, velocity), turn=_narrowed(whole.turn, commanded, turn)
    )


def _narrowed(whole: tuple[float, float], commanded: ActuatorTable, place: int | None) -> tuple[float, float]:
    if place is None:
        return whole
    field = commanded.fields[place]
    low = whole[0] if field.low is None else max(whole[0], field.low)
    high = whole[1] if field.high is None else min(whole[1], field.high)
    return (low, high)
