"""The actuator of the base: the one that a program binds to it, or the built-in one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from colony.ir.servers import OMNIDIRECTIONAL_RSERVER, RSERVER
from colony.ir.types import ScalarValue
from colony.runtime.arbitration.motion import Speeds
from colony.runtime.protocol.deployment import ActuatorSpec, Deployment, actuators_of
from colony.runtime.servers.built_in import built_in_actuator
from colony.runtime.servers.drivers import BaseLimits
from colony.runtime.servers.motion_commands import Range, full_range

FRAME_NS = 50_000_000
"""Frame period of a robot without a program, in nanoseconds."""

_DRIVE = RSERVER.commands[0]
_DRIVE_SIDEWAYS = OMNIDIRECTIONAL_RSERVER.commands[0]

_BUILT_IN = built_in_actuator(RSERVER.name, _DRIVE, idle=(0.0, 0.0))
_BUILT_IN_SIDEWAYS = built_in_actuator(RSERVER.name, _DRIVE_SIDEWAYS, idle=(0.0, 0.0, 0.0))


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
        return values_of(self.spec, speeds)


def values_of(actuator: ActuatorSpec, speeds: Speeds) -> tuple[float, ...]:
    """Return the values of an actuator's fields for these speeds; a speed without a field is dropped."""
    values = [0.0] * len(actuator.fields)
    for i, speed in zip(_indices(actuator), speeds, strict=True):
        if i is not None:
            values[i] = speed
    return tuple(values)


def speeds_of(actuator: ActuatorSpec, values: tuple[ScalarValue, ...]) -> Speeds:
    """Return the speeds of a command in base units; a missing parameter is 0."""
    return Speeds(*[0.0 if i is None else float(values[i]) for i in _indices(actuator)])


def sent_speeds(actuator: ActuatorSpec, values: tuple[ScalarValue, ...], proposed: Speeds) -> Speeds:
    """Return the speeds of an outside command as it was sent; a speed without a field is the proposed one."""
    pairs = zip(_indices(actuator), proposed, strict=True)
    return Speeds(*[speed if i is None else float(values[i]) for i, speed in pairs])


def base_actuator(deployed: Deployment | None, limits: BaseLimits) -> BaseActuator:
    """Return the actuator bound to the base in a valid deployment, else the built-in one."""
    built_in = _BUILT_IN_SIDEWAYS if limits.sideways > 0.0 else _BUILT_IN
    if deployed is None:
        return BaseActuator(run="", frame_ns=FRAME_NS, spec=built_in, allowed=full_range(limits), clients={})
    specs = actuators_of(deployed, RSERVER.name)
    spec = specs[0] if specs else built_in
    return BaseActuator(
        run=deployed.run,
        frame_ns=deployed.frame_ns,
        spec=spec,
        allowed=_range(spec, limits),
        clients={priority: name for name, priority in spec.clients},
        published=bool(specs),
        lockstep=deployed.lockstep,
    )


def mismatch(deployed: Deployment, limits: BaseLimits) -> str | None:
    """Return the reason why a deployment does not fit the base with these limits, or None."""
    return next(_mismatches(deployed, limits), None)


def _mismatches(deployed: Deployment, limits: BaseLimits) -> Iterator[str]:
    if not deployed.run:
        yield "a run without a name"
    specs = [spec for spec in deployed.actuators if spec.server == RSERVER.name]
    if len(specs) > 1:
        names = " and ".join(f"`{spec.name}`" for spec in specs)
        yield f"{names} command the base; expected one actuator"
    for spec in specs:
        yield from _spec_mismatches(spec, limits)


def _spec_mismatches(spec: ActuatorSpec, limits: BaseLimits) -> Iterator[str]:
    if spec.command != _DRIVE.name:
        yield f"`{spec.name}`: {RSERVER.name} has no command `{spec.command}`"
    count = len(spec.fields)
    expected = (len(_DRIVE.parameters), len(_DRIVE_SIDEWAYS.parameters))
    if len(spec.field_indices) not in expected:
        yield f"`{spec.name}`: {len(spec.field_indices)} parameters; expected {expected[0]} or {expected[1]}"
    elif _indices(spec)[-1] is not None and limits.sideways == 0.0:
        yield f"`{spec.name}`: it drives sideways, which this base cannot"
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
    velocity, turn, sideways = _indices(spec)
    return full._replace(
        velocity=_narrow(full.velocity, spec, velocity),
        turn=_narrow(full.turn, spec, turn),
        sideways=_narrow(full.sideways, spec, sideways),
    )


def _indices(spec: ActuatorSpec) -> tuple[int | None, int | None, int | None]:
    """Return the indices of the fields of velocity, turn and sideways speed; None for one without a field.

    An actuator that was bound to a base that cannot drive sideways has no index for it.
    """
    velocity, turn, sideways = (*spec.field_indices, None)[: len(_DRIVE_SIDEWAYS.parameters)]
    return velocity, turn, sideways


def _narrow(full: tuple[float, float], spec: ActuatorSpec, index: int | None) -> tuple[float, float]:
    if index is None:
        return full
    field = spec.fields[index]
    low = full[0] if field.low is None else max(full[0], field.low)
    high = full[1] if field.high is None else min(full[1], field.high)
    return (low, high)
