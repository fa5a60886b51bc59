"""Contradictions within a body, which has otherwise been read."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Protocol

from colony.body.devices import (
    BaseSpec,
    BatterySpec,
    BumperSpec,
    Button,
    CameraSpec,
    CeilingCameraSpec,
    CliffSpec,
    Device,
    DockSensorSpec,
    EncodersSpec,
    JointSpec,
    LidarSpec,
    Output,
    Proximity,
    RangeFinder,
    RotaryJoint,
    ValueField,
    ValuesSpec,
)
from colony.body.model import Body, Circle, Omnidirectional, Polygon, Rolling, ServerTable, radius_mm
from colony.body.ros2 import BASE_NAMES, BASE_TYPES, Ros2Topic, action_of, unit_problem
from colony.ir.bearings import TURN, too_many_hint, uniform
from colony.ir.servers import COMMON_SERVERS, MAX_SERVER_NAME, PROXIMITY, RESERVED_SERVER_NAMES, RSERVER
from colony.ir.types import DISTANCE, Array, type_text
from colony.text.diagnostics import Diagnostic, Label, error
from colony.text.source import Span
from colony.text.units import readable_unit
from colony.text.wording import degrees_text, did_you_mean, quoted, shortened

# --- device consistency -------------------------------------------------------------------------------
#
# Contradictions within the devices of a body, and between each and the robot's shape.

MAX_POSITIONS = 100
"""Maximum number of positions of a joint."""

MAX_OUTPUTS = 100
"""Maximum number of outputs, or values, of a device."""

REACH_MM = 2000.0
"""Distance beyond the footprint up to which a device can be on a robot; farther off, a unit is wrong."""


class Located(Protocol):
    """The places of a body's keys and values."""

    def key(self, *keys: str) -> Span:
        """Return the span of a key."""
        ...

    def value(self, *keys: str) -> Span:
        """Return the span of a value."""
        ...


def device_contradictions(
    device: Device | None, body: Body, places: Located, keys: tuple[str, ...]
) -> Iterator[Diagnostic]:
    """Yield an error for each part of a device that contradicts another part or the body."""
    match device:
        case Proximity() as ring:
            yield from _proximity(ring, body, places, keys)
        case LidarSpec() as lidar:
            yield from _turn(lidar.step_deg, lidar.count, places, keys)
            yield from misplaced(lidar.pose, (*keys, "pose"), body, places)
        case RangeFinder() as finder:
            yield from _range_finder(finder, body, places, keys)
        case BumperSpec() as bumper:
            yield from _bumper(bumper, places, keys)
        case CameraSpec(pose=pose) | DockSensorSpec(pose=pose):
            yield from misplaced(pose, (*keys, "pose"), body, places)
        case CliffSpec() as cliff:
            for place in cliff.places:
                yield from misplaced(place, (*keys, "places"), body, places)
        case JointSpec() as joint:
            yield from _joint(joint, "mm", places, keys)
        case RotaryJoint() as joint:
            yield from _joint(joint, "deg", places, keys)
        case EncodersSpec() as encoders:
            yield from _encoders(encoders, body, places, keys)
        case _:
            yield from _unplaced(device, places, keys)


def _unplaced(device: Device | None, places: Located, keys: tuple[str, ...]) -> Iterator[Diagnostic]:
    """Yield the contradictions of a device that has no place on the robot."""
    match device:
        case Output(outputs=outputs) if not 0 < len(outputs) <= MAX_OUTPUTS:
            message = f"{len(outputs)} outputs; expected 1 to {MAX_OUTPUTS}"
            yield error("B009", places.value(*keys, "outputs"), message)
        case ValuesSpec(values=values) if not 0 < len(values) <= MAX_OUTPUTS:
            yield error(
                "B009", places.value(*keys, "values"), f"{len(values)} values; expected 1 to {MAX_OUTPUTS}"
            )
        case ValuesSpec(values=values):
            for name, value in values.items():
                yield from _value(value, places, (*keys, "values", name))
        case BatterySpec() as battery:
            yield from _battery(battery, places, keys)
        case Button(names=names) if len(set(names)) < len(names):
            twice = next(name for i, name in enumerate(names) if name in names[:i])
            yield error("B009", places.value(*keys, "fields"), f"two buttons have the field `{twice}`")
        case _:
            pass


def misplaced(
    place: tuple[float, ...], keys: tuple[str, ...], body: Body, places: Located
) -> Iterator[Diagnostic]:
    """Yield an error for a place, or a pose, that is not on the robot, nor near it."""
    away, reach = math.hypot(*place[:2]), radius_mm(body) + REACH_MM
    if away > reach:
        message = f"a place {away:g} mm from the center of the robot; expected at most {reach:g} mm"
        hint = f"it is more than {REACH_MM:g} mm outside of the footprint: are the units right?"
        yield error("B009", places.value(*keys), message, hint)


def _joint(
    joint: JointSpec | RotaryJoint, unit: str, places: Located, keys: tuple[str, ...]
) -> Iterator[Diagnostic]:
    low, high = joint.ends
    if low >= high:
        message = f"the range begins at {low:g} {unit}, which is not below its end, {high:g} {unit}"
        yield error("B009", places.value(*keys, "range"), message, "write the lower end first")
        return
    where = places.value(*keys, "positions")
    if joint.positions and joint.control == "velocity":
        message = "a joint that runs at a velocity is not sent to positions"
        hint = 'leave out `positions`, or `control = "velocity"`'
        yield error("B009", where, message, hint)
    if len(joint.positions) > MAX_POSITIONS:
        message = f"{len(joint.positions)} positions; expected at most {MAX_POSITIONS}"
        yield error("B009", where, message)
    for name, position in joint.positions.items():
        if not low <= position <= high:
            message = (
                f"the position `{name}` is at {position:g} {unit}, outside of the range, "
                f"{low:g} to {high:g} {unit}"
            )
            label = Label(places.value(*keys, "range"), "the range of the joint")
            yield error("B009", places.value(*keys, "positions", name), message, None, label)


def _value(field: ValueField, places: Located, keys: tuple[str, ...]) -> Iterator[Diagnostic]:
    """Yield an error for each value that is not of the field's type, and for what its type cannot have."""
    first = field.amount
    is_number = not isinstance(first.value, bool | str)
    for key, amount in field.amounts:
        where = places.value(*keys, key)
        if isinstance(amount.value, str) and amount.value not in field.members:
            message = f"`{amount.value}` is none of the `members`"
            hint = did_you_mean(amount.value, field.members) or "list it there"
            yield error("B009", where, message, hint)
        elif type(amount.value) is not type(first.value) or amount.dimension != first.dimension:
            yield error("B009", where, "the values are of several types", "give all of them like `value`")
    noise = field.noise
    if noise is not None and not (is_number and isinstance(noise.value, float) and noise.value >= 0.0):
        hint = "write a number of at least 0, or leave it out"
        yield error("B009", places.value(*keys, "noise"), "only numbers have noise, which is a number", hint)
    elif noise is not None and noise.dimension != first.dimension:
        unit = readable_unit(first.dimension).text
        message = f"the noise is not in the unit of the value; expected one in {unit}"
        yield error("B009", places.value(*keys, "noise"), message)
    if field.edge == "fading" and not is_number:
        yield error("B009", places.value(*keys, "edge"), "only numbers fade", 'write `edge = "sharp"`')


def _encoders(
    encoders: EncodersSpec, body: Body, places: Located, keys: tuple[str, ...]
) -> Iterator[Diagnostic]:
    wheels = len(body.chassis.drive.rolling)
    if not wheels:
        message = "encoders of wheels that the drive does not describe"
        yield error("B009", places.value(*keys, "device"), message, "write `wheel_base` in `[body.drive]`")
    elif encoders.wheels != wheels:
        message = f"encoders of {encoders.wheels} wheels; the drive has {wheels}"
        where = places.value(*keys, "device" if encoders.wheels == 2 else "wheels")
        yield error("B009", where, message, f"write `wheels = {wheels}`")


def _battery(battery: BatterySpec, places: Located, keys: tuple[str, ...]) -> Iterator[Diagnostic]:
    if 0.0 < battery.charger_w <= battery.standing_w:
        message = (
            f"the charger gives {battery.charger_w:g} W, and the robot takes {battery.standing_w:g} W: "
            "it is never charged"
        )
        yield error("B009", places.value(*keys, "charger"), message, "leave it out if there is none")


def _proximity(ring: Proximity, body: Body, places: Located, keys: tuple[str, ...]) -> Iterator[Diagnostic]:
    yield from _turn(ring.step_deg, ring.count, places, keys)
    footprint = body.chassis.footprint
    if isinstance(footprint, Circle) and ring.ring_mm > footprint.radius_mm:
        message = (
            f"the ring of {ring.ring_mm:g} mm is outside the footprint, whose radius is "
            f"{footprint.radius_mm:g} mm"
        )
        yield error("B009", places.value(*keys, "ring"), message)
    if ring.sonar.nearest_mm >= ring.sonar.range_mm:
        message = f"the smallest reading, {ring.sonar.nearest_mm:g} mm, is not below the one without an echo"
        yield error("B009", places.value(*keys, "sonar", "nearest"), message)
    beyond = [k for k in ring.infrared.wired or () if k >= ring.count]
    if beyond:
        message = f"`wired` has element {beyond[0]}; the ring has elements 0 to {ring.count - 1}"
        yield error("B009", places.value(*keys, "infrared", "wired"), message)


def _turn(step_deg: float | None, count: int, places: Located, keys: tuple[str, ...]) -> Iterator[Diagnostic]:
    if step_deg is not None and uniform(0.0, step_deg, count) is None:
        message = f"{count} elements that are {degrees_text(step_deg)} apart take more than a full turn"
        yield error("B009", places.value(*keys, "step"), message, too_many_hint(step_deg, count))


def _range_finder(
    finder: RangeFinder, body: Body, places: Located, keys: tuple[str, ...]
) -> Iterator[Diagnostic]:
    for pose in finder.poses:
        yield from misplaced(pose, (*keys, "poses"), body, places)
    if finder.nearest_mm >= finder.range_mm:
        message = f"the smallest reading, {finder.nearest_mm:g} mm, is not below the longest range"
        label = Label(places.value(*keys, "range"), "the longest range")
        yield error("B009", places.value(*keys, "nearest"), message, None, label)


def _bumper(bumper: BumperSpec, places: Located, keys: tuple[str, ...]) -> Iterator[Diagnostic]:
    """Yield an error for each sector that is none."""
    for first, last in bumper.sectors:
        text = f"`{degrees_text(first)} .. {degrees_text(last)}`"
        if max(abs(first), abs(last)) > TURN:
            message, hint = (
                f"the sector {text} has a bearing of more than a turn",
                "bearings are within 360 deg",
            )
        elif first == last:
            message, hint = f"the sector {text} has no width", "write all bearings as `-180 deg .. 180 deg`"
        else:
            continue
        yield error("B009", places.value(*keys, "sectors"), message, hint)


# --- consistency --------------------------------------------------------------------------------------

_COMMON_NAMES = frozenset(server.name for server in COMMON_SERVERS)

_FIXED_NAMES: tuple[tuple[type, str, str], ...] = (
    (BaseSpec, RSERVER.name, "base"),
    (Proximity, PROXIMITY, "proximity"),
)
"""The devices that one server alone serves, with its name."""


def contradictions(body: Body, places: Located) -> Iterator[Diagnostic]:
    """Yield an error for each part of a body that contradicts another."""
    yield from _footprint(body, places)
    yield from _sideways(body, places)
    for name, server in body.servers.items():
        keys = ("server", name)
        if name in _COMMON_NAMES:
            hint = "its variables need no table"
            yield error("B009", places.key(*keys), f"every robot has `{name}`; a body does not say so", hint)
        elif server.simulated is None and not server.is_real:
            hint = (
                'write `simulated = { device = "..." }`, `hardware = { driver = "module:Class" }` or `ros2`'
            )
            yield error(
                "B009", places.key(*keys), f"`{name}` has no device: neither simulated nor real", hint
            )
        yield from _unusable_name(name, places)
        yield from _fixed_name(name, server, places)
        yield from _faults(server, places, keys)
        yield from _topics(name, body, places)
        yield from device_contradictions(server.simulated, body, places, (*keys, "simulated"))
        yield from _fields(name, body, places)


def _unusable_name(name: str, places: Located) -> Iterator[Diagnostic]:
    """Yield an error for a name that the process of a server cannot have."""
    if name in RESERVED_SERVER_NAMES:
        message = f"`{name}` is reserved for the runtime, and no server can have it"
    elif len(name) > MAX_SERVER_NAME or name.startswith("_"):
        message = (
            f"`{shortened(name)}` cannot be the name of a server: expected at most {MAX_SERVER_NAME} "
            "characters, of which the first is a letter"
        )
    else:
        return
    yield error("B009", places.key("server", name), message, "give the server another name")


def _fixed_name(name: str, server: ServerTable, places: Located) -> Iterator[Diagnostic]:
    """Yield an error for a device that the server of this name does not serve."""
    for type_, fixed, word in _FIXED_NAMES:
        if isinstance(server.simulated, type_) and name != fixed:
            message = f'the device "{word}" is served by `{fixed}` alone, and a robot has one'
            hint = f"write it in `[server.{fixed}]`"
        elif server.simulated is not None and not isinstance(server.simulated, type_) and name == fixed:
            message, hint = f'`{fixed}` serves the device "{word}" alone', "give the server another name"
        else:
            continue
        yield error("B009", places.value("server", name, "simulated", "device"), message, hint)
    if isinstance(server.simulated, CameraSpec | CeilingCameraSpec) and server.is_real:
        key = "ros2" if server.hardware is None else "hardware"
        message = f"`{name}` is a camera: cameras have no drivers of their own yet"
        yield error("B009", places.key("server", name, key), message, f"leave out `{key}`")


def _topics(name: str, body: Body, places: Located) -> Iterator[Diagnostic]:
    """Yield an error for each topic of ROS 2 that its server cannot have."""
    server, is_base = body.servers[name], isinstance(body.device(name), BaseSpec)
    keys = ("server", name, "ros2")
    if server.ros2 and server.hardware is not None:
        message = f"`{name}` has a driver and topics of ROS 2"
        yield error("B009", places.key(*keys), message, "leave out `hardware` or `ros2`")
    for key, topic in server.ros2.items():
        types = BASE_TYPES.get(key, ())
        if is_base and key not in BASE_NAMES:
            message = f"`{name}` has no topic `{key}`"
            hint = did_you_mean(key, BASE_NAMES) or f"expected {quoted(BASE_NAMES, 'or')}"
            yield error("B009", places.key(*keys, key), message, hint)
        elif is_base and types and topic.type not in types:
            message = f"`{key}` of a base is not {topic.type}"
            yield error("B009", places.value(*keys, key, "type"), message, f"expected {quoted(types, 'or')}")
        if (problem := unit_problem(topic)) is not None:
            yield error("B007", places.value(*keys, key, "unit"), problem)
        yield from _actions(key, server.ros2, is_base, places, keys)


def _actions(
    key: str, topics: Mapping[str, Ros2Topic], is_base: bool, places: Located, keys: tuple[str, ...]
) -> Iterator[Diagnostic]:
    """Yield an error for a key of `ros2` that is not either a topic or an action, as its type says."""
    topic, first = topics[key], action_of(topics)
    if not topic.name:
        message = f"`{'.'.join((*keys, key))}` has no `topic`"
        yield error("B004", places.key(*keys, key), message, "write `topic`, or `action` for a command")
    elif topic.topic and topic.action:
        yield error("B009", places.key(*keys, key), f"`{key}` is both a topic and an action")
    elif bool(topic.action) != ("/action/" in topic.type):
        word = "action" if topic.action else "topic"
        message = (
            f"`{key}` is of the type {topic.type}, which is not that of a{'n' * bool(topic.action)} {word}"
        )
        hint = f"write `{'topic' if topic.action else 'action'} = ...`, or another type"
        yield error("B009", places.value(*keys, key, "type"), message, hint)
    elif topic.action and is_base:
        hint = "give it a server of its own"
        yield error("B009", places.key(*keys, key), "a base has no actions", hint)
    elif topic.action and first is not None and first[0] != key:
        message = f"`{first[0]}` and `{key}` are actions: a server has one"
        yield error("B009", places.key(*keys, key), message, "give each a server of its own")


def _faults(server: ServerTable, places: Located, keys: tuple[str, ...]) -> Iterator[Diagnostic]:
    """Yield an error for faults that the device cannot have."""
    if server.faults is None:
        return
    if server.simulated is None:
        message = f"`{keys[-1]}` has faults, but no simulated device"
        hint = "only simulated devices have faults: leave out `faults`"
        yield error("B009", places.key(*keys, "faults"), message, hint)
    elif isinstance(server.simulated, CameraSpec | CeilingCameraSpec):
        message = f"`{keys[-1]}` is a camera: its images are asked for, and have no faults"
        yield error("B009", places.key(*keys, "faults"), message, "leave out `faults`")
    elif server.faults.missing + server.faults.frozen >= 1.0:
        message = "its readings are missing or frozen all the time"
        hint = "`missing` and `frozen` together are below 100 percent"
        yield error("B009", places.key(*keys, "faults"), message, hint)


def _fields(name: str, body: Body, places: Located) -> Iterator[Diagnostic]:
    """Yield an error for each part of a field's table that its device contradicts.

    The driver of a base measures what the base does; that of another device may have fields of its own.
    """
    keys = ("server", name, "fields")
    server, device = body.servers[name], body.device(name)
    specs = {} if device is None else {spec.name: spec for spec in device.fields}
    is_closed = isinstance(device, BaseSpec) or (device is not None and not server.is_real)
    for field, own in server.fields.items():
        spec = specs.get(field)
        if own.blocked and own.no_echo_mm is None:
            message = f"`{name}.{field}` has blocked bearings and no `no_echo`, which their elements read"
            hint = 'give `no_echo`, such as `no_echo = "12 m"`'
            yield error("B009", places.key(*keys, field, "blocked"), message, hint)
        if spec is None:
            if is_closed:
                known = f"it has {quoted(list(specs))}" if specs else "it has none"
                message = f"the device of `{name}` has no field `{field}`"
                yield error("B009", places.key(*keys, field), message, did_you_mean(field, specs) or known)
        elif own.no_echo_mm is not None:
            where = places.value(*keys, field, "no_echo")
            if not isinstance(spec.type, Array) or spec.type.element != DISTANCE:
                own_type = type_text(spec.type)
                message = f"`{name}.{field}` is {own_type}; only ranges have a reading without an echo"
                yield error("B009", where, message)
            elif spec.no_echo is not None and own.no_echo_mm < spec.no_echo:
                message = (
                    f"an element without an echo reads {own.no_echo_mm:g} mm, and the device measures "
                    f"up to {spec.no_echo:g} mm"
                )
                yield error(
                    "B009",
                    where,
                    message,
                    "it would pass for an echo: write at least the range of the device",
                )


def _footprint(body: Body, places: Located) -> Iterator[Diagnostic]:
    footprint = body.chassis.footprint
    if isinstance(footprint, Circle):
        return
    where = places.value("body", "footprint", "corners")
    sides = _sides(footprint)
    pairs = zip(sides, (*sides[1:], sides[0]), strict=True)
    turns = [x * next_y - y * next_x for (x, y), (next_x, next_y) in pairs]
    if area_mm2(footprint) <= 0.0:
        hint = "list them in the order in which one passes them to the left"
        yield error("B009", where, "the corners do not go around the footprint counterclockwise", hint)
    elif min(turns) < 0.0:
        yield error("B009", where, "the footprint is not convex", "leave out the corners that are inside")
    elif _turned_deg(sides) > 540.0:
        hint = "list each of them once"
        yield error("B009", where, "the corners go around the footprint more than once", hint)


def _sideways(body: Body, places: Located) -> Iterator[Diagnostic]:
    """Yield an error for each limit of sideways motion of a base that cannot move sideways."""
    if isinstance(body.chassis.drive, Omnidirectional):
        yield from _omni_wheels(body.chassis.drive, body, places)
        return
    limits = body.chassis.limits
    given = (
        ("sideways", limits.sideways_mm_s),
        ("sideways_acceleration", limits.sideways_acceleration_mm_s2),
    )
    for key, value in given:
        if value is not None:
            message = f"`{key}` is a limit of a base that drives sideways, and this one has two driven wheels"
            hint = 'leave it out, or write `kind = "omnidirectional"` in `[body.drive]`'
            label = Label(places.value("body", "drive", "kind"), "the drive")
            yield error("B009", places.key("body", "limits", key), message, hint, label)


def _omni_wheels(drive: Omnidirectional, body: Body, places: Located) -> Iterator[Diagnostic]:
    """Yield an error for wheels that are described twice, in part, or that leave the base a way to slide."""
    given = [key for key, value in _MECANUM if getattr(drive, value) is not None]
    if drive.wheels and given:
        message = f"`{given[0]}` describes mecanum wheels, and `wheels` omni wheels"
        yield error("B009", places.key("body", "drive", given[0]), message, "leave out one of them")
    elif len(given) == 1:
        [other] = {key for key, _ in _MECANUM}.difference(given)
        message = f"`{given[0]}` alone describes no mecanum wheels"
        yield error("B009", places.key("body", "drive", given[0]), message, f"write `{other}`, too")
    for wheel in drive.wheels:
        yield from misplaced(wheel, ("body", "drive", "wheels"), body, places)
    if drive.wheels and not _hold(drive.rolling):
        message = "the wheels let the base slide or turn without rolling"
        hint = "they roll in several directions, and not all of them toward or past one point"
        yield error("B009", places.value("body", "drive", "wheels"), message, hint)


_MECANUM = (("wheel_base", "wheel_base_mm"), ("wheel_distance", "wheel_distance_mm"))


def _hold(wheels: tuple[Rolling, ...]) -> bool:
    """Return True if every motion rolls some wheel: three of them are independent."""
    reach = max(abs(wheel.turn_mm) for wheel in wheels)
    return reach > 0.0 and any(
        abs(
            a.ahead * (b.left * c.turn_mm - c.left * b.turn_mm)
            - a.left * (b.ahead * c.turn_mm - c.ahead * b.turn_mm)
            + a.turn_mm * (b.ahead * c.left - c.ahead * b.left)
        )
        > 1e-3 * reach
        for a, b, c in combinations(wheels, 3)
    )


def _turned_deg(sides: list[tuple[float, float]]) -> float:
    """Return by how much the sides of a convex polygon turn in all: 360 deg for each time around."""
    directions = [math.atan2(y, x) for x, y in sides if x or y]
    pairs = zip(directions, (*directions[1:], directions[0]), strict=True)
    return math.degrees(sum((after - before) % math.tau for before, after in pairs))


def _sides(polygon: Polygon) -> list[tuple[float, float]]:
    """Return the sides of a polygon, from each corner to the next, in mm."""
    corners = polygon.corners
    pairs = zip(corners, (*corners[1:], corners[0]), strict=True)
    return [(b.x_mm - a.x_mm, b.y_mm - a.y_mm) for a, b in pairs]


def area_mm2(polygon: Polygon) -> float:
    """Return the area that corners enclose, positive where they go counterclockwise."""
    corners = polygon.corners
    pairs = zip(corners, (*corners[1:], corners[0]), strict=True)
    return sum(a.x_mm * b.y_mm - b.x_mm * a.y_mm for a, b in pairs) / 2.0
