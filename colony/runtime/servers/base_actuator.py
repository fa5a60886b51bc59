"""The actuator of the base: the one that a program binds to it or the built-in one, its values and speeds."""

from __future__ import annotations

from collections.abc import Sequence

from colony.ir.servers import OMNIDIRECTIONAL_RSERVER, RSERVER
from colony.ir.types import ScalarValue
from colony.runtime.arbitration.motion import STILL, Speeds
from colony.runtime.protocol.deployment import ActuatorSpec
from colony.runtime.servers import built_in
from colony.runtime.servers.built_in import built_in_actuator
from colony.runtime.servers.drivers import BaseLimits
from colony.runtime.servers.motion_commands import Range, full_range

DRIVE = RSERVER.commands[0].name
"""Name of the command that drives the base."""

_DRIVE = built_in_actuator(RSERVER.name, RSERVER.commands[0], idle=(0.0, 0.0))
_DRIVE_SIDEWAYS = built_in_actuator(RSERVER.name, OMNIDIRECTIONAL_RSERVER.commands[0], idle=(0.0, 0.0, 0.0))


def base_actuator(limits: BaseLimits) -> ActuatorSpec:
    """Return the built-in actuator of a base."""
    return _DRIVE_SIDEWAYS if limits.sideways > 0.0 else _DRIVE


def values_of(actuator: ActuatorSpec, speeds: Speeds) -> tuple[float, ...]:
    """Return the values of an actuator's fields for these speeds; a speed without a field is dropped."""
    values = [0.0] * len(actuator.fields)
    for i, speed in zip(_indices(actuator), speeds, strict=True):
        if i is not None:
            values[i] = speed
    return tuple(values)


def speeds_of(actuator: ActuatorSpec, values: tuple[ScalarValue, ...], proposed: Speeds = STILL) -> Speeds:
    """Return the speeds of a command in base units; a speed without a field is the proposed one."""
    pairs = zip(_indices(actuator), proposed, strict=True)
    return Speeds(*[speed if i is None else float(values[i]) for i, speed in pairs])


def allowed_range(actuator: ActuatorSpec, limits: BaseLimits) -> Range:
    """Return an actuator's range within the base's limits; a speed without a field has the base's limits."""
    full = full_range(limits)
    velocity, turn, sideways = _indices(actuator)
    return full._replace(
        velocity=_narrow(full.velocity, actuator, velocity),
        turn=_narrow(full.turn, actuator, turn),
        sideways=_narrow(full.sideways, actuator, sideways),
    )


def mismatch(specs: Sequence[ActuatorSpec], limits: BaseLimits) -> str | None:
    """Return the reason why a program's actuators do not fit the base with these limits, or None.

    A program for a base that drives sideways fits any other one if it does not declare that speed, and a
    program for any other base fits this one.
    """
    is_wide = any(len(spec.field_indices) == len(_DRIVE_SIDEWAYS.fields) for spec in specs)
    wrong = built_in.mismatch(RSERVER.name, {DRIVE: _DRIVE_SIDEWAYS if is_wide else _DRIVE}, specs)
    if wrong is None and limits.sideways == 0.0 and any(_indices(spec)[2] is not None for spec in specs):
        return f"`{specs[0].name}`: it drives sideways, which this base cannot"
    return wrong


def _indices(spec: ActuatorSpec) -> tuple[int | None, int | None, int | None]:
    """Return the indices of the fields of velocity, turn and sideways speed; None for one without a field.

    An actuator that was bound to a base that cannot drive sideways has no index for it.
    """
    velocity, turn, sideways = (*spec.field_indices, None)[: len(_DRIVE_SIDEWAYS.fields)]
    return velocity, turn, sideways


def _narrow(full: tuple[float, float], spec: ActuatorSpec, index: int | None) -> tuple[float, float]:
    if index is None:
        return full
    field = spec.fields[index]
    low = full[0] if field.low is None else max(full[0], field.low)
    high = full[1] if field.high is None else min(full[1], field.high)
    return (low, high)
