"""The interface of a robot, as digests: what a program was checked against, held to what a robot is.

A robot that is served with a description has its interface; the Clock refuses a program that was checked
against another. Limits and other declarations of a description belong to the program, not to the interface.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from hashlib import blake2b

import msgspec

from colony.ir.program import Actuator, ActuatorField, Robot, Sensor
from colony.ir.types import Array, Enum, Type
from colony.text.wording import listed

MAX_PARTS = 1000
"""Maximum number of parts of an interface with digests of their own; a larger interface has one digest."""

MAX_LISTED = 5
"""Maximum number of parts that a message lists."""

FRAME = "frame period"
"""Name of the part that is the frame period; no sensor is called like this."""


class InterfacePart(msgspec.Struct, frozen=True, array_like=True):
    """The digest of a sensor, of an actuator, or of the frame period."""

    name: str
    digest: str


class Interface(msgspec.Struct, frozen=True, kw_only=True):
    """The interface of a robot; no parts stand for that of a robot without a description."""

    robot: str = ""
    parts: tuple[InterfacePart, ...] = ()


def interface_of(robot: Robot) -> Interface:
    """Return the interface that a program declares."""
    parts = [InterfacePart(FRAME, _digest(robot.frame_ns))]
    parts += [InterfacePart(s.name, _digest(*_sensor(s))) for s in robot.sensors if s.sent is None]
    parts += [InterfacePart(a.name, _digest(*_actuator(a))) for a in robot.actuators]
    if len(parts) > MAX_PARTS:
        parts = [InterfacePart("", _digest(*parts))]
    return Interface(robot=robot.name, parts=tuple(parts))


def interface_problem(program: Interface, served: Interface) -> str | None:
    """Return the reason why a program does not fit a robot; None if it does.

    It fits a robot that has more than the program was checked against.
    """
    if not program.parts or not served.parts:
        return None
    found = list(_differences(program.parts, {part.name: part.digest for part in served.parts}))
    if not found:
        return None
    more = [f"{len(found) - MAX_LISTED} more"] if len(found) > MAX_LISTED else []
    shown = listed([*found[:MAX_LISTED], *more], "and")
    return (
        f"the program was checked against another interface (`{program.robot}`) than the robot's "
        f"(`{served.robot}`): {shown}"
    )


def _differences(parts: Iterable[InterfacePart], served: dict[str, str]) -> Iterator[str]:
    for part in parts:
        if part.name not in served:
            yield f"`{part.name}` is not there"
        elif served[part.name] != part.digest:
            yield f"`{part.name}` differs"


def _sensor(sensor: Sensor) -> Iterator[object]:
    yield from (_type(sensor.type), sensor.unit, sensor.factor, sensor.low, sensor.high, sensor.default)
    yield from (sensor.server, sensor.field, sensor.within_ns)


def _actuator(actuator: Actuator) -> Iterator[object]:
    yield from (actuator.server, actuator.command, actuator.idle, actuator.on_loss)
    yield from (_field(field) for field in actuator.fields)


def _field(field: ActuatorField) -> tuple[object, ...]:
    return (field.name, _type(field.type), field.unit, field.factor, field.low, field.high, field.default)


def _type(type_: Type) -> tuple[object, ...]:
    """Return a type by what it is, not by the name of its enum, which depends on imports."""
    match type_:
        case Array(element=element, size=size, bearings=bearings):
            return size, bearings, _type(element)
        case Enum(members=members):
            return members
        case _:
            return (str(type_),)


def _digest(*values: object) -> str:
    return blake2b(repr(values).encode(), digest_size=8).hexdigest()
