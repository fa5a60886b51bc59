"""The actuator of the base: the one that a program binds to it, or the built-in one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from colony.ir.program import Actuator, ActuatorField
from colony.ir.types import ScalarValue
from colony.runtime.arbitration.motion import Speeds
from colony.runtime.protocol.bindings import ActuatorBinding
from colony.runtime.protocol.deployment import ActuatorSpec, Deployment, actuator_spec, actuators_of
from colony.runtime.protocol.fields import RSERVER
from colony.runtime.servers.drivers import BaseLimits
from colony.runtime.servers.motion_commands import Range, full_range

FRAME_NS = 50_000_000
"""Frame period of a robot without a program, in nanoseconds."""

_DRIVE = RSERVER.commands[0]

_BUILT_IN = actuator_spec(
    Actuator(
        name=_DRIVE.name,
        fields=tuple(ActuatorField(name=p.name, type=p.type) for p in _DRIVE.parameters),
        server=RSERVER.name,
        command=_DRIVE.name,
        idle=(0.0, 0.0),
    ),
    ActuatorBinding(actuator=_DRIVE.name, server=RSERVER.name, command=_DRIVE.name, field_indices=(0, 1)),
    (),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseActuator:
    """The actuator of the base in a run, its range, and its clients by priority.

    `published` is True if its verdicts are published; it is False for a program that does not bind the base.
    """

    run: str
    frame_ns: int
    spec: ActuatorSpec
    allowed: Range
    clients: Mapping[int, str]
    published: bool = True
    lockstep: bool = False

    @property
    def name(self) -> str:
        """Name of the actuator."""
        return self.spec.name

    def values(self, speeds: Speeds) -> tuple[float, ...]:
        """Return the values of the actuator for these speeds; a speed without a field is dropped."""
        values = [0.0] * len(self.spec.fields)
        for i, speed in zip(self.spec.field_indices, speeds, strict=True):
            if i is not None:
                values[i] = speed
        return tuple(values)


def speeds_of(actuator: ActuatorSpec, values: tuple[ScalarValue, ...]) -> Speeds:
    """Return the speeds of a command in base units; a missing parameter is 0."""
    velocity, turn = (0.0 if i is None else float(values[i]) for i in actuator.field_indices)
    return Speeds(velocity, turn)


def sent_speeds(actuator: ActuatorSpec, values: tuple[ScalarValue, ...], proposed: Speeds) -> Speeds:
    """Return the speeds of an outside command as it was sent; a speed without a field is the proposed one."""
    pairs = zip(actuator.field_indices, proposed, strict=True)
    return Speeds(*[speed if i is None else float(values[i]) for i, speed in pairs])


def base_actuator(deployed: Deployment | None, limits: BaseLimits) -> BaseActuator:
    """Return the actuator bound to the base in a valid deployment, else the built-in one."""
    if deployed is None:
        return BaseActuator(run="", frame_ns=FRAME_NS, spec=_BUILT_IN, allowed=full_range(limits), clients={})
    specs = actuators_of(deployed, RSERVER.name)
    spec = specs[0] if specs else _BUILT_IN
    return BaseActuator(
        run=deployed.run,
        frame_ns=deployed.frame_ns,
        spec=spec,
        allowed=_range(spec, limits),
        clients={priority: name for name, priority in spec.clients},
        published=bool(specs),
        lockstep=deployed.lockstep,
    )


def mismatch(deployed: Deployment) -> str | None:
    """Return the reason why a deployment does not fit the base, or None."""
    return next(_mismatches(deployed), None)


def _mismatches(deployed: Deployment) -> Iterator[str]:
    if not deployed.run:
        yield "a run without a name"
    specs = [spec for spec in deployed.actuators if spec.server == RSERVER.name]
    if len(specs) > 1:
        names = " and ".join(f"`{spec.name}`" for spec in specs)
        yield f"{names} command the base; expected one actuator"
    for spec in specs:
        yield from _spec_mismatches(spec)


def _spec_mismatches(spec: ActuatorSpec) -> Iterator[str]:
    if spec.command != _DRIVE.name:
        yield f"`{spec.name}`: {RSERVER.name} has no command `{spec.command}`"
    count = len(spec.fields)
    if len(spec.field_indices) != len(_DRIVE.parameters):
        yield f"`{spec.name}`: {len(spec.field_indices)} parameters; expected {len(_DRIVE.parameters)}"
    if any(i is not None and not 0 <= i < count for i in spec.field_indices):
        yield f"`{spec.name}`: a parameter is not one of its {count} fields"
    if any(field.kind != "number" for field in spec.fields):
        yield f"`{spec.name}`: a field is not a number"
    if any(not math.isfinite(field.factor) or field.factor == 0.0 for field in spec.fields):
        yield f"`{spec.name}`: a factor is 0 or not finite"
    if spec.idle is not None and not all(map(_is_finite_number, spec.idle)):
        yield f"`{spec.name}`: an idle command with a value that is not finite"
    priorities = [priority for _, priority in spec.clients]
    if priorities != sorted(priorities, reverse=True):
        yield f"`{spec.name}`: the clients are not in the order of their priorities"


def _is_finite_number(value: ScalarValue) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _range(spec: ActuatorSpec, limits: BaseLimits) -> Range:
    """Return the program's range within the base's limits; a speed without a field has the base's limits."""
    full = full_range(limits)
    velocity, turn = spec.field_indices
    return full._replace(velocity=_narrow(full.velocity, spec, velocity), turn=_narrow(full.turn, spec, turn))


def _narrow(full: tuple[float, float], spec: ActuatorSpec, index: int | None) -> tuple[float, float]:
    if index is None:
        return full
    field = spec.fields[index]
    low = full[0] if field.low is None else max(full[0], field.low)
    high = full[1] if field.high is None else min(full[1], field.high)
    return (low, high)
