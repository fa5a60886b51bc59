"""A robot's interface and its body, held to each other."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from colony.body.devices import (
    BaseSpec,
    BumperSpec,
    CameraSpec,
    CeilingCameraSpec,
    CliffSpec,
    Device,
    Directed,
    DockSensorSpec,
    EncodersSpec,
    JointSpec,
    LidarSpec,
    Output,
    Proximity,
    RangeFinder,
    RotaryJoint,
    ValuesSpec,
)
from colony.body.model import Body, ServerTable
from colony.body.reader import BodyFile
from colony.body.ros2 import (
    DRIVE,
    GOAL_STATES,
    ODOM,
    STATUS,
    Ros2Topic,
    action_of,
    field_topic,
    is_scan,
    parameter_path,
    path_of,
)
from colony.body.servers import servers_of
from colony.ir.bearings import LIST_STEP, TURN, between
from colony.ir.fitting import (
    declaration_misfits,
    field_named,
    fits,
    server_named,
    shared_commands,
)
from colony.ir.program import Actuator, ActuatorField, Robot, Sensor
from colony.ir.ros2_messages import AUTO, AXES, TWIST, TWIST_STAMPED, TWISTS, part_problem
from colony.ir.servers import FieldSpec, ServerSpec
from colony.ir.types import DISTANCE, Array, Enum, Quantity, bearings_of, element_type, is_percent
from colony.text.diagnostics import Diagnostic, Label, error, warning
from colony.text.wording import counted, degrees_text, did_you_mean, duration_text, quoted

_SAME_WITHIN_DEG = 1e-6
"""The angle between bearings that count as equal: a text in radians is rounded."""

_PLACE_WITHIN_DEG = LIST_STEP
"""The largest angle between a bearing and the direction of its place: an index this far off is outside."""


def findings(robot: Robot, file: BodyFile) -> tuple[Diagnostic, ...]:
    """Return what is wrong with a body itself, and between it and an interface."""
    if file.body is None:
        return file.diagnostics
    return (*file.diagnostics, *disagreements(robot, file.body, file))


def disagreements(robot: Robot, body: Body, file: BodyFile) -> Iterator[Diagnostic]:
    """Yield what is wrong between an interface and a body: errors, and warnings of what nothing reads.

    What does not fit the servers of the body has the codes of `colony.ir.fitting`, and is reported at the
    declaration; what only a body has is reported there.
    """
    yield from _identity(robot, body, file)
    servers = servers_of(body, robot)
    for sensor in robot.sensors:
        if sensor.of_robot:
            yield from _sensor(sensor, servers, body, file)
    for actuator in robot.actuators:
        yield from _actuator(actuator, servers, body, file)
    yield from shared_commands(robot.actuators)
    yield from _topics(robot, body, file)
    yield from _unread(robot, body, file)
    yield from unwatched_devices(robot, body, file)


def unwatched_devices(
    robot: Robot | None, body: Body, file: BodyFile, servers: Sequence[str] | None = None
) -> Iterator[Diagnostic]:
    """Yield a warning for each device, of these servers or all, that stops by itself in no case.

    The body of a device that is stopped when it is idle has to say whether it does.
    """
    stopped = {a.server for a in (() if robot is None else robot.actuators) if a.idle is not None}
    for name, server in body.servers.items():
        if server.hardware is None or (servers is not None and name not in servers):
            continue
        if server.hardware.watchdog == "none":
            message = f"nothing stops `{name}` when its computer fails or its cable is pulled"
            place = file.value("server", name, "hardware", "watchdog")
            hint = "stay within reach of its switch: the guard of its port ends with the computer"
            yield warning("B019", place, message, hint)
        elif server.hardware.watchdog is None and name in stopped:
            message = f"`{name}` has no `watchdog`: nothing may stop it when its computer fails"
            place = file.value("server", name, "hardware", "driver")
            hint = 'write after what time it stops by itself, `watchdog = "2 s"`, or `watchdog = "none"`'
            yield warning("B019", place, message, hint)


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


def _sensor(
    sensor: Sensor, servers: Sequence[ServerSpec], body: Body, file: BodyFile
) -> Iterator[Diagnostic]:
    server = body.servers.get(sensor.server)
    offered = server_named(sensor.server, servers)
    spec = None if offered is None else field_named(sensor.field, offered)
    if server is None or spec is None:
        yield from (_with_body(d, sensor, body, file) for d in declaration_misfits(sensor, servers))
        return
    size = list(_size(sensor, spec, server, file))
    found = size or [_with_body(d, sensor, body, file) for d in declaration_misfits(sensor, servers)]
    yield from found
    bare = [] if found else list(_bare(sensor, server, file))
    yield from bare
    if not found:
        yield from _bearings(sensor, server, file)
        if not bare:
            yield from _ends(sensor, server, file)
        yield from _blocked(sensor, server, file)
    yield from _times(sensor, server, body, file)


def _with_body(misfit: Diagnostic, declared: Sensor | Actuator, body: Body, file: BodyFile) -> Diagnostic:
    """Return an error of a declaration that does not fit its server, with the server's table."""
    server = body.servers.get(declared.server)
    if server is None:
        return misfit
    device = body.device(declared.server)
    here = Label(file.key("server", declared.server), f"the body describes `{declared.server}` here")
    if isinstance(declared, Actuator) or misfit.code != "R002" or device is not None:
        return replace(misfit, labels=(here,))
    hint = did_you_mean(declared.field, server.fields)
    hint = hint or f"list it in the body: `fields.{declared.field} = {{}}`"
    return replace(misfit, hint=hint, labels=(here,))


def _size(sensor: Sensor, spec: FieldSpec, server: ServerTable, file: BodyFile) -> Iterator[Diagnostic]:
    """Yield an error where a sensor has more or fewer elements than its device."""
    if not isinstance(spec.type, Array) or not fits(element_type(sensor.type), spec.type.element):
        return
    size = sensor.type.size if isinstance(sensor.type, Array) else None
    if size != spec.type.size:
        found = "is no array" if size is None else f"has {counted(size, 'element')}"
        message = f"`{sensor.name}` {found}, and its device has {spec.type.size}"
        where = file.value("server", sensor.server, "simulated", _size_key(server.simulated))
        yield error("B013", where, message, None, Label(sensor.span, "declared here"))


def _size_key(device: Device | None) -> str:
    """Return the key that says how many elements a device has."""
    match device:
        case CliffSpec():
            return "places"
        case RangeFinder():
            return "poses"
        case BumperSpec():
            return "sectors"
        case EncodersSpec():
            return "wheels" if device.wheels != 2 else "device"
        case _:
            return "count"


def _bearings(sensor: Sensor, server: ServerTable, file: BodyFile) -> Iterator[Diagnostic]:
    """Yield an error where an element looks along another bearing than that of the device."""
    device = server.simulated
    if isinstance(device, BumperSpec) and sensor.field == device.field:
        yield from _sectors(sensor, device, file)
    if isinstance(device, CliffSpec) and sensor.field == device.field:
        yield from _places(sensor, device, file)
    if not isinstance(device, Directed) or sensor.field not in {f.name for f in device.fields}:
        return
    own, theirs = bearings_of(sensor.type), device.bearings()
    if own is None or theirs is None:
        return
    for i, (angle, other) in enumerate(zip(own.angles, theirs.angles, strict=True)):
        if _between(angle, other) > _SAME_WITHIN_DEG:
            step = "poses" if isinstance(device, RangeFinder) else "bearing" if i == 0 else "step"
            where = file.value("server", sensor.server, "simulated", step)
            message = (
                f"`{sensor.name}[{i}]` looks along {degrees_text(angle)}, and its device along "
                f"{degrees_text(other)}"
            )
            yield error("B014", where, message, None, Label(sensor.span, "declared here"))
            return


def _sectors(sensor: Sensor, bumper: BumperSpec, file: BodyFile) -> Iterator[Diagnostic]:
    """Yield an error where an element of a bumper looks along a bearing outside of its sector."""
    own = bearings_of(sensor.type)
    for i, (first, last) in enumerate(() if own is None else bumper.sectors):
        if own is not None and i not in between(own, first, last):
            message = (
                f"`{sensor.name}[{i}]` is at {degrees_text(own.angles[i])}, outside of its sector, "
                f"{degrees_text(first)} .. {degrees_text(last)}"
            )
            where = file.value("server", sensor.server, "simulated", "sectors")
            yield error("B014", where, message, None, Label(sensor.span, "declared here"))
            return


def _bare(sensor: Sensor, server: ServerTable, file: BodyFile) -> Iterator[Diagnostic]:
    """Yield an error for each number without a unit of a field that the interface declares in percent."""
    device = server.simulated
    if not (is_percent(sensor.type) and isinstance(device, ValuesSpec) and sensor.field in device.values):
        return
    field = device.values[sensor.field]
    noise = () if field.noise is None else (("noise", field.noise),)
    for key, (value, _, unit) in (*field.amounts, *noise):
        if not unit and value and isinstance(value, float):
            where = file.value("server", sensor.server, "simulated", "values", sensor.field, key)
            message = f"found `{value:.10g}` without a unit; `{sensor.name}` is in percent"
            hint = (
                f"write `{value:.10g} percent`, or `{value * 100:.10g} percent` for {value:.10g} of the whole"
            )
            yield error("B007", where, message, hint, Label(sensor.span, "declared here"))


def _places(sensor: Sensor, cliff: CliffSpec, file: BodyFile) -> Iterator[Diagnostic]:
    """Yield an error where an element looks away from its place, or towards another one's place."""
    own, places = bearings_of(sensor.type), cliff.directions()
    for i, angle in enumerate(() if own is None else own.angles):
        place = places[i]
        if place is None or own is None:
            continue
        nearest = min(_between(angle, other) for other in places if other is not None)
        off = _between(angle, place)
        if off > _PLACE_WITHIN_DEG or off > nearest + _SAME_WITHIN_DEG:
            message = (
                f"`{sensor.name}[{i}]` looks along {degrees_text(angle)}, and its place lies along "
                f"{degrees_text(round(place, 1))}"
            )
            order = ", ".join(degrees_text(x) for x in _in_order_of(places, own.angles))
            where = file.value("server", sensor.server, "simulated", "places")
            hint = f"in the order of the places the bearings are `[{order}]`"
            yield error("B014", where, message, hint, Label(sensor.span, "declared here"))
            return


def _in_order_of(places: Sequence[float | None], angles: Sequence[float]) -> Sequence[float]:
    """Return the angles in the order of the places, or the places' own where an angle fits none of them."""
    order = [
        a if p is None else min(angles, key=lambda x: _between(x, p))
        for p, a in zip(places, angles, strict=True)
    ]
    fits_all = all(
        p is None or _between(p, a) <= _PLACE_WITHIN_DEG for p, a in zip(places, order, strict=True)
    )
    if fits_all and sorted(order) == sorted(angles):
        return order
    return [a if p is None else float(round(p)) for p, a in zip(places, angles, strict=True)]


def _between(a: float, b: float) -> float:
    """Return the angle between two directions, in degrees."""
    return abs((a - b + TURN / 2) % TURN - TURN / 2)


def _ends(sensor: Sensor, server: ServerTable, file: BodyFile) -> Iterator[Diagnostic]:
    """Yield an error where a reading is beyond the sensor's range, which would clamp it."""

    def shown(value: float) -> str:
        return f"{value / sensor.factor:g} {sensor.unit or 'number'}"

    declared = Label(sensor.span, "declared here")
    hint = "a reading beyond the range counts as its end: give the sensor a wider one"
    for path, (low, high) in _readings(sensor, server).items():
        where = file.value("server", sensor.server, *path)
        if sensor.high is not None and high > sensor.high:
            found = f"has a range up to {shown(sensor.high)}, and its device reads {shown(high)}"
            yield error("B015", where, f"`{sensor.name}` {found}", hint, declared)
        if sensor.low is not None and low < sensor.low:
            found = f"has a range from {shown(sensor.low)}, and its device reads {shown(low)}"
            yield error("B015", where, f"`{sensor.name}` {found}", hint, declared)


def _readings(sensor: Sensor, server: ServerTable) -> dict[tuple[str, ...], tuple[float, float]]:
    """Return the least and greatest readings that a body knows of a sensor, by the keys that say so."""
    own, of = server.fields.get(sensor.field), element_type(sensor.type)
    found: dict[tuple[str, ...], tuple[float, float]] = {}
    if own is not None and own.no_echo_mm is not None and of == DISTANCE:
        found["fields", sensor.field, "no_echo"] = (own.no_echo_mm, own.no_echo_mm)
    match server.simulated:
        case Proximity() as ring if sensor.field == "sonar":
            found["simulated", "sonar", "range"] = (ring.sonar.range_mm, ring.sonar.range_mm)
        case LidarSpec() as lidar if sensor.field == lidar.field:
            found["simulated", "range"] = (lidar.range_mm, lidar.range_mm)
        case RangeFinder() as finder if sensor.field == finder.field:
            found["simulated", "range"] = (finder.range_mm, finder.range_mm)
            if finder.nearest_mm:
                found["simulated", "nearest"] = (finder.nearest_mm, finder.nearest_mm)
        case (JointSpec() | RotaryJoint()) as joint if sensor.field in ("position", "target") and isinstance(
            of, Quantity
        ):
            found["simulated", "range"] = joint.ends
        case (JointSpec() | RotaryJoint()) as joint if sensor.field == "velocity":
            found["simulated", "speed"] = (-joint.speed, joint.speed)
        case DockSensorSpec() as dock_sensor if sensor.field == "dock_distance":
            found["simulated", "range"] = (0.0, dock_sensor.farthest_mm)
        case ValuesSpec(values=values) if sensor.field in values and isinstance(of, Quantity):
            for key, amount in values[sensor.field].amounts:
                ends = found.get(("simulated", "values", sensor.field, key), (math.inf, -math.inf))
                value = float(amount.value)
                ends = (min(ends[0], value), max(ends[1], value))
                found["simulated", "values", sensor.field, key] = ends
        case Output(outputs=outputs) if outputs.get(sensor.field) == "level":
            found["simulated", "outputs", sensor.field] = (0.0, 1.0)
        case _:
            pass
    return found


def _blocked(sensor: Sensor, server: ServerTable, file: BodyFile) -> Iterator[Diagnostic]:
    """Yield an error for each blocked interval in which no element looks."""
    own, bearings = server.fields.get(sensor.field), bearings_of(sensor.type)
    for i, (low, high) in enumerate(() if own is None else own.blocked):
        if bearings is None or not between(bearings, low, high):
            text = f"{degrees_text(low)} .. {degrees_text(high)}"
            found = "has no bearings" if bearings is None else f"has no element in `{text}`"
            message = f"`{sensor.name}` {found}, which the body blocks (interval {i + 1})"
            where = file.value("server", sensor.server, "fields", sensor.field, "blocked")
            yield error("B014", where, message, None, Label(sensor.span, "declared here"))


def _times(sensor: Sensor, server: ServerTable, body: Body, file: BodyFile) -> Iterator[Diagnostic]:
    """Yield an error where a field is measured less often, or arrives later, than it is read."""
    if sensor.within_ns is None:
        return
    read = f"and read `within {duration_text(sensor.within_ns)}`"
    here = Label(sensor.span, "read here")
    keys = ("server", sensor.server)
    own, period_ns = server.fields.get(sensor.field), server.period_ns(sensor.field) or 0
    delay_ns = round(body.chassis.delays.reading_s * 1e9)
    rare, late = f"is measured every {duration_text(period_ns)}", f"arrives {duration_text(delay_ns)} after"
    hint = "it would be missing in frames between two measurements: allow more time, or measure more often"
    if period_ns and period_ns + delay_ns > sensor.within_ns:
        path = ("fields", sensor.field, "rate") if own is not None and own.rate_hz is not None else ("rate",)
        message = f"`{sensor.name}` {rare}, {read}"
        if period_ns <= sensor.within_ns:
            message = f"`{sensor.name}` {rare} and {late}, {read}"
        yield error("B017", file.value(*keys, *path), message, hint, here)
    elif delay_ns > sensor.within_ns:
        message = f"`{sensor.name}` {late} it is measured, {read}"
        hint = "it would be missing in every frame: allow more time"
        yield error("B017", file.value("body", "delays", "reading"), message, hint, here)


def _actuator(
    actuator: Actuator, servers: Sequence[ServerSpec], body: Body, file: BodyFile
) -> Iterator[Diagnostic]:
    found = list(declaration_misfits(actuator, servers))
    yield from (_with_body(d, actuator, body, file) for d in found)
    if not found and actuator.server in body.servers and isinstance(body.device(actuator.server), BaseSpec):
        limits = body.chassis.limits
        highest = {
            "velocity": limits.velocity_mm_s,
            "turn": limits.turn_deg_s,
            "sideways": body.chassis.sideways_mm_s,
        }
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
    if float(top) * field.factor > limit:  # it was rounded up
        top = f"{limit / field.factor * (1.0 - 1e-9):.10g}"
    hint = f"the base refuses what is beyond: write `range -{top} .. {top}`"
    yield error("B016", field.span, message, hint, here)


def _topics(robot: Robot, body: Body, file: BodyFile) -> Iterator[Diagnostic]:
    """Yield an error for each topic of ROS 2 that cannot be what the interface declares."""
    sensors = {(s.server, s.field): s for s in reversed(robot.sensors) if s.of_robot}
    commands = {(a.server, a.command): a for a in robot.actuators}
    for name, server in body.servers.items():
        is_base = isinstance(body.device(name), BaseSpec)
        for key, topic in server.ros2.items():
            keys, sensor = ("server", name, "ros2", key), sensors.get((name, key))
            command = commands.get((name, key))
            is_command = command is not None
            if is_base:
                if key not in (DRIVE, ODOM):
                    yield from _part(topic, file, keys)
                continue
            if sensor is None and not is_command:
                message = f"nothing in the interface reads or commands `{name}.{key}`"
                yield warning("B018", file.key(*keys), message)
            elif sensor is not None and is_command:
                message = f"`{name}.{key}` is both read and commanded, and has one topic"
                hint = "declare the sensor or the actuator under another name, with a topic of its own"
                yield error("B009", file.key(*keys), message, hint)
            elif sensor is not None and topic.type == AUTO:
                message = "a sensor cannot read the type `auto`"
                hint = f"write `{TWIST}` or `{TWIST_STAMPED}`"
                yield error("B009", file.value(*keys, "type"), message, hint)
            elif sensor is not None and is_scan(topic) and bearings_of(sensor.type) is None:
                message = f"`{sensor.name}` has no bearings, and reads a scan"
                hint = "declare them: `bearing -180 deg step 1 deg`"
                declared = Label(sensor.span, "declared here")
                yield error("B014", file.value(*keys, "type"), message, hint, declared)
            elif command is not None:
                yield from _set_parts(topic, command, file, keys)
            else:
                yield from _part(topic, file, keys)

        if (action := action_of(server.ros2)) is not None:
            yield from _goals(name, action[0], server, robot, file)


def _part(topic: Ros2Topic, file: BodyFile, keys: tuple[str, ...]) -> Iterator[Diagnostic]:
    """Yield an error for a field whose message has no such part, as far as its type is known here."""
    if (problem := part_problem(topic.type, path_of(topic))) is not None:
        hint = None if topic.path else 'name the part of the message: `path = "..."`'
        yield error("B009", file.value(*keys, "path" if topic.path else "type"), problem, hint)


def _set_parts(
    topic: Ros2Topic, command: Actuator, file: BodyFile, keys: tuple[str, ...]
) -> Iterator[Diagnostic]:
    """Yield an error for each parameter of a command for which the message has no part."""
    for parameter in command.fields:
        path = parameter_path(topic, parameter.name)
        if topic.type in TWISTS:
            problem = None if path in AXES else f"a twist has no `{path}`: it has {quoted(AXES)}"
        elif len(command.fields) == 1 and parameter.name not in topic.parameters:
            problem = part_problem(topic.type, "data", is_sent=True)
        else:
            problem = part_problem(topic.type, path, is_sent=True)
        if problem is not None:
            where = file.value(*keys, "parameters", parameter.name) if topic.parameters else file.key(*keys)
            hint = f'name the part of the message: `parameters = {{ {parameter.name} = "..." }}`'
            yield error("B009", where, problem, hint, Label(parameter.span, "declared here"))


def _goals(
    server_name: str, command: str, server: ServerTable, robot: Robot, file: BodyFile
) -> Iterator[Diagnostic]:
    """Yield an error for an actuator or a sensor that cannot be a goal of an action, or its state."""
    place = file.key("server", server_name, "ros2", command)
    for actuator in robot.actuators:
        if (actuator.server, actuator.command) == (server_name, command) and actuator.idle is not None:
            message = f"`{actuator.name}` is the goal of an action, and is idle without one"
            declared = Label(actuator.span, "declared here")
            yield error(
                "B009", place, message, "declare it with `idle hold`: the goal is then canceled", declared
            )
    for sensor in robot.sensors:
        if sensor.server != server_name or sensor.sent is not None:
            continue
        topic = field_topic(server.ros2, sensor.field)
        if topic is None or not topic.action or topic.path != STATUS:
            continue
        members = dict(sensor.type.members) if isinstance(sensor.type, Enum) else {}
        if missing := [state for state in GOAL_STATES if state not in members]:
            message = f"`{sensor.name}` is the state of a goal, and lacks {quoted(missing, 'and')}"
            states = ", ".join(f"{state} = {i}" for i, state in enumerate(GOAL_STATES))
            declared = Label(sensor.span, "declared here")
            yield error("B009", place, message, f"declare an enum {{ {states} }}", declared)


def _unread(robot: Robot, body: Body, file: BodyFile) -> Iterator[Diagnostic]:
    """Yield a warning for each server, and each field of a server, that the interface does not name."""
    read = {(s.server, s.field) for s in robot.sensors if s.of_robot}
    named = {server for server, _ in read} | {a.server for a in robot.actuators}
    for name, server in body.servers.items():
        if name not in named:
            if not isinstance(server.simulated, CameraSpec | CeilingCameraSpec):
                message = f"nothing in the interface reads or commands `{name}`"
                yield warning("B018", file.key("server", name), message)
            continue
        for field in server.fields:
            if (name, field) not in read:
                message = f"nothing in the interface reads `{name}.{field}`"
                yield warning("B018", file.key("server", name, "fields", field), message)
