"""A robot's interface and its body, held to each other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from colony.body.consistency import COMMON_SERVERS
from colony.body.devices import Base, Camera, CeilingCamera, Lidar, Proximity
from colony.body.model import Body, Limits, Server
from colony.body.reader import BodyFile
from colony.ir.bearings import TURN, between
from colony.ir.program import Actuator, ActuatorField, Robot, Sensor
from colony.ir.types import DISTANCE, Array, bearings_of, element_type
from colony.text.diagnostics import Diagnostic, Label, error, warning
from colony.text.suggestions import did_you_mean
from colony.text.wording import counted, degrees_text, duration_text, quoted

_SAME_WITHIN_DEG = 1e-6
"""The angle between bearings that count as equal: a text in radians is rounded."""


def disagreements(robot: Robot, body: Body, file: BodyFile) -> Iterator[Diagnostic]:
    """Yield what is wrong between an interface and a body: errors, and warnings of what nothing reads."""
    yield from _identity(robot, body, file)
    sensors = [s for s in robot.sensors if s.server not in COMMON_SERVERS and s.sent is None]
    actuators = [a for a in robot.actuators if a.server not in COMMON_SERVERS]
    yield from _unknown_servers([*sensors, *actuators], body.servers)
    for sensor in sensors:
        server = body.servers.get(sensor.server)
        if server is not None:
            yield from _sensor(sensor, server, file)
    for actuator in actuators:
        server = body.servers.get(actuator.server)
        if server is not None:
            yield from _actuator(actuator, server, body.chassis.limits, file)
    yield from _unread(sensors, actuators, body, file)


def _identity(robot: Robot, body: Body, file: BodyFile) -> Iterator[Diagnostic]:
    declared = Label(robot.span, "the interface declares it here")
    if body.robot.name != robot.name:
        message = f"the body is that of `{body.robot.name}`, the interface that of `{robot.name}`"
        yield error("B010", file.value("robot", "name"), message, None, declared)
    if body.robot.frame_s is not None and round(body.robot.frame_s * 1e9) != robot.frame_ns:
        found = duration_text(round(body.robot.frame_s * 1e9))
        message = (
            f"the body has a frame period of {found}, the interface one of {duration_text(robot.frame_ns)}"
        )
        yield error("B011", file.value("robot", "frame"), message, None, declared)


def _unknown_servers(
    declarations: Iterable[Sensor | Actuator], servers: Mapping[str, Server]
) -> Iterator[Diagnostic]:
    """Yield an error for the first sensor or actuator of each server that the body lacks."""
    unknown: set[str] = set()
    for declared in declarations:
        if declared.server not in servers and declared.server not in unknown:
            unknown.add(declared.server)
            known = f"it has {quoted(list(servers))}" if servers else "it has none"
            hint = did_you_mean(declared.server, servers) or known
            message = f"`{declared.name}`: the body has no server `{declared.server}`"
            yield error("B012", declared.span, message, hint)


def _sensor(sensor: Sensor, server: Server, file: BodyFile) -> Iterator[Diagnostic]:
    names = server.field_names()
    keys = ("server", sensor.server)
    if sensor.field not in names:
        known = f"it has {quoted(names)}" if names else f"write `fields.{sensor.field} = {{ ... }}`"
        message = f"`{sensor.name}`: `{sensor.server}` has no field `{sensor.field}` in the body"
        yield error("B012", sensor.span, message, did_you_mean(sensor.field, names) or known)
        return
    yield from _elements(sensor, server, file)
    yield from _highest(sensor, server, file)
    own = server.fields.get(sensor.field)
    for i, (low, high) in enumerate(() if own is None else own.blocked):
        bearings = bearings_of(sensor.type)
        if bearings is None or not between(bearings, low, high):
            text = f"{degrees_text(low)} .. {degrees_text(high)}"
            found = "has no bearings" if bearings is None else f"has no element in `{text}`"
            message = f"`{sensor.name}` {found}, which the body blocks (interval {i + 1})"
            where = file.value(*keys, "fields", sensor.field, "blocked")
            yield error("B014", where, message, None, Label(sensor.span, "declared here"))
    rate = server.rate_of(sensor.field)
    if rate is not None and sensor.within_ns is not None and 1e9 / rate > sensor.within_ns:
        path = ("fields", sensor.field, "rate") if own is not None and own.rate_hz is not None else ("rate",)
        message = (
            f"`{sensor.name}` is measured every {duration_text(round(1e9 / rate))}, and read "
            f"`within {duration_text(sensor.within_ns)}`"
        )
        hint = (
            "it would be missing in frames between two measurements: allow more time, or measure more often"
        )
        yield error("B017", file.value(*keys, *path), message, hint, Label(sensor.span, "read here"))


def _elements(sensor: Sensor, server: Server, file: BodyFile) -> Iterator[Diagnostic]:
    """Yield an error where a sensor has other elements than its device."""
    device = server.simulated
    if not isinstance(device, Proximity | Lidar) or sensor.field not in device.fields:
        return
    keys = ("server", sensor.server, "simulated")
    declared = Label(sensor.span, "declared here")
    size = sensor.type.size if isinstance(sensor.type, Array) else None
    if size != device.count:
        found = "is no array" if size is None else f"has {counted(size, 'element')}"
        message = f"`{sensor.name}` {found}, and its device has {device.count}"
        yield error("B013", file.value(*keys, "count"), message, None, declared)
        return
    own, theirs = bearings_of(sensor.type), device.bearings()
    if own is None or theirs is None:
        return
    for i, (angle, other) in enumerate(zip(own.angles, theirs.angles, strict=True)):
        if abs((angle - other + TURN / 2) % TURN - TURN / 2) > _SAME_WITHIN_DEG:
            key = "bearing" if i == 0 else "step"
            message = (
                f"`{sensor.name}[{i}]` looks along {degrees_text(angle)}, and its device along "
                f"{degrees_text(other)}"
            )
            yield error("B014", file.value(*keys, key), message, None, declared)
            return


def _highest(sensor: Sensor, server: Server, file: BodyFile) -> Iterator[Diagnostic]:
    """Yield an error where a reading is beyond the sensor's range, which would clamp it."""
    own, keys = server.fields.get(sensor.field), ("server", sensor.server)
    found: dict[tuple[str, ...], float] = {}
    if own is not None and own.no_echo_mm is not None:
        found["fields", sensor.field, "no_echo"] = own.no_echo_mm
    match server.simulated:
        case Proximity() as ring if sensor.field == "sonar":
            found[("simulated", "sonar", "range")] = ring.sonar.range_mm
        case Lidar() as lidar if sensor.field == lidar.field:
            found[("simulated", "range")] = lidar.range_mm
        case _:
            pass
    is_length = element_type(sensor.type) == DISTANCE
    for path, value in found.items():
        if is_length and sensor.high is not None and value > sensor.high:
            message = (
                f"`{sensor.name}` has a range up to {sensor.high:g} mm, and its device reads {value:g} mm"
            )
            declared = Label(sensor.span, "declared here")
            hint = "a reading beyond the range counts as its end: give the sensor a wider one"
            yield error("B015", file.value(*keys, *path), message, hint, declared)


def _actuator(actuator: Actuator, server: Server, limits: Limits, file: BodyFile) -> Iterator[Diagnostic]:
    device = server.simulated
    if device is None:
        return
    if actuator.command not in device.commands:
        known = f"it takes {quoted(device.commands)}" if device.commands else "it takes none"
        message = (
            f"`{actuator.name}`: the device of `{actuator.server}` takes no command `{actuator.command}`"
        )
        yield error("B012", actuator.span, message, did_you_mean(actuator.command, device.commands) or known)
        return
    if isinstance(device, Base):
        highest = {"velocity": limits.velocity_mm_s, "turn": limits.turn_deg_s}
        for field in actuator.fields:
            if field.name in highest:
                yield from _range(actuator, field, highest[field.name], file)


def _range(actuator: Actuator, field: ActuatorField, limit: float, file: BodyFile) -> Iterator[Diagnostic]:
    """Yield an error where a field of the drive may be beyond the base's limit."""
    unit = f" {field.unit}" if field.unit else ""
    name, limit_text = f"`{actuator.name}.{field.name}`", f"{limit / field.factor:.10g}{unit}"
    beyond = [x for x in (field.low, field.high) if x is not None and abs(x) > limit * (1.0 + 1e-12)]
    if beyond:
        message = f"{name} reaches {beyond[0] / field.factor:.10g}{unit}, and the base at most {limit_text}"
    elif field.low is None or field.high is None:
        message = f"{name} has no range, and the base reaches at most {limit_text}"
    else:
        return
    here = Label(file.value("body", "limits", field.name), "the limit of the base")
    top = f"{limit / field.factor:.10g}"
    hint = f"the base refuses what is beyond: write `range -{top} .. {top}`"
    yield error("B016", field.span, message, hint, here)


def _unread(
    sensors: Iterable[Sensor], actuators: Iterable[Actuator], body: Body, file: BodyFile
) -> Iterator[Diagnostic]:
    """Yield a warning for each server, and each field of a server, that the interface does not name."""
    read = {(s.server, s.field) for s in sensors}
    named = {server for server, _ in read} | {a.server for a in actuators}
    for name, server in body.servers.items():
        if name not in named:
            if not isinstance(server.simulated, Camera | CeilingCamera):
                message = f"nothing in the interface reads or commands `{name}`"
                yield warning("B018", file.key("server", name), message)
            continue
        for field in server.fields:
            if (name, field) not in read:
                message = f"nothing in the interface reads `{name}.{field}`"
                yield warning("B018", file.key("server", name, "fields", field), message)
