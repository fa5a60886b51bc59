"""The interface of a robot, as digests: what a program was checked against, held to what a robot is.

A robot that is served with a description has its interface; the Clock refuses a program that was checked
against another. Limits and other declarations of a description belong to the program, not to the interface.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from hashlib import blake2b

import msgspec

from colony.ir.program import Actuator, ActuatorField, Robot, Sensor
from colony.ir.types import Array, Enum, Type, bearings_of
from colony.text.wording import listed

MAX_DIGESTS = 5000
"""Maximum number of digests of an interface; a larger interface has one digest."""

MAX_LISTED = 5
"""Maximum number of parts that a message lists."""

FRAME = "frame period"
"""Name of the part that is the frame period; no sensor is called like this."""


class InterfacePart(msgspec.Struct, frozen=True, array_like=True):
    """The digests of a sensor, an actuator, or the frame period, by what they are of, such as `range`."""

    name: str
    digests: dict[str, str]


class Interface(msgspec.Struct, frozen=True, kw_only=True):
    """The interface of a robot; no parts stand for that of a robot without a description."""

    robot: str = ""
    parts: tuple[InterfacePart, ...] = ()

    @property
    def size(self) -> int:
        """The number of digests; of parts without any, at least that of parts."""
        return sum(max(len(part.digests), 1) for part in self.parts)


def interface_of(robot: Robot) -> Interface:
    """Return the interface that a program declares."""
    parts = [_part(FRAME, {"length": robot.frame_ns})]
    parts += [_part(s.name, _sensor(s)) for s in robot.sensors if s.of_robot]
    parts += [_part(a.name, _actuator(a)) for a in robot.actuators]
    found = Interface(robot=robot.name, parts=tuple(parts))
    if found.size > MAX_DIGESTS:
        return Interface(robot=robot.name, parts=(_part("interface", {"content": parts}),))
    return found


def interface_problem(program: Interface, served: Interface) -> str | None:
    """Return the reason why a program does not fit a robot; None if it does.

    It fits a robot that has more than the program was checked against.
    """
    if not program.parts or not served.parts:
        return None
    found = list(_differences(program.parts, {part.name: part.digests for part in served.parts}))
    if not found:
        return None
    more = [f"{len(found) - MAX_LISTED} more"] if len(found) > MAX_LISTED else []
    shown = listed([*found[:MAX_LISTED], *more], "and")
    return (
        f"the program was checked against another interface (`{program.robot}`) than the robot's "
        f"(`{served.robot}`): {shown}"
    )


def _differences(parts: Iterable[InterfacePart], served: dict[str, dict[str, str]]) -> Iterator[str]:
    for part in parts:
        if part.name not in served:
            yield f"`{part.name}` is not there"
        elif served[part.name] != part.digests:
            ours, theirs = part.digests, served[part.name]
            differing = [key for key in {**ours, **theirs} if ours.get(key) != theirs.get(key)]
            yield f"`{part.name}` differs ({listed(differing, 'and')})"


def _sensor(sensor: Sensor) -> dict[str, object]:
    return {
        "type": (_type(sensor.type), sensor.unit, sensor.factor),
        "bearings": bearings_of(sensor.type),
        "range": (sensor.low, sensor.high),
        "default": sensor.default,
        "from": (sensor.server, sensor.field),
        "within": sensor.within_ns,
    }


def _actuator(actuator: Actuator) -> dict[str, object]:
    return {
        **{f"field `{field.name}`": _field(field) for field in actuator.fields},
        "order of fields": [field.name for field in actuator.fields],
        "to": (actuator.server, actuator.command),
        "idle": actuator.idle,
        "on_loss": actuator.on_loss,
    }


def _field(field: ActuatorField) -> tuple[object, ...]:
    return (field.name, _type(field.type), field.unit, field.factor, field.low, field.high, field.default)


def _type(type_: Type) -> tuple[object, ...]:
    """Return a type by what it is, not by the name of its enum, which depends on imports."""
    match type_:
        case Array(element=element, size=size):
            return size, _type(element)
        case Enum(members=members):
            return members
        case _:
            return (str(type_),)


def _part(name: str, contents: Mapping[str, object]) -> InterfacePart:
    return InterfacePart(name, {key: _digest(content) for key, content in contents.items()})


def _digest(content: object) -> str:
    return blake2b(repr(content).encode(), digest_size=8).hexdigest()
