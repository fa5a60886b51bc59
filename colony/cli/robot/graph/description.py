"""The interface and the body of a robot from the topics that were chosen, with a comment on each guess."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from colony.cli.robot.graph.choice import NUMBERS, ChosenScan, ChosenTopics
from colony.cli.ros2_texts import base_lines, chassis_lines, drive_lines
from colony.ir.ros2_messages import BOOL
from colony.ros2.survey import SurveyedTopic

VELOCITY_M_S, TURN_RAD_S = 0.3, 1.0
"""The highest speeds that are guessed: no topic has them."""

RADIUS_MM = 250.0
"""The radius of a hull that no URDF describes."""

CLEARANCE_MM, REACTION_S = 100.0, 1.0
"""Distance that a limit keeps between hull and echo, and time in which the robot may use up the rest."""

NICE_MS = (200, 300, 500, 1000, 2000, 3000, 5000, 10_000, 30_000, 60_000)
"""The values of `within` in ms."""

PERIODS = 2.5
"""The periods of a topic after which its newest message is too old."""

UNHEARD_MS = 2000
"""The `within` of a topic of which too few messages came to know its rate, in ms."""


class _Row(NamedTuple):
    """A sensor of the interface."""

    name: str
    type: str
    range: str
    source: str
    within: str
    comment: str = ""


class _Topic(NamedTuple):
    """A topic of the body: its server, its field, its keys, and a comment."""

    server: str
    field: str
    keys: Mapping[str, str]
    comment: str = ""


def within_ms(topic: SurveyedTopic) -> int:
    """Return the age in ms from which the newest message of a topic does not count."""
    if topic.rate_hz is None:
        return UNHEARD_MS
    least = PERIODS * 1000.0 / topic.rate_hz
    return next((each for each in NICE_MS if each >= max(least, 300.0)), NICE_MS[-1])


def _within(topic: SurveyedTopic) -> str:
    ms = within_ms(topic)
    return f"within {ms} ms" if ms < 1000 else f"within {ms / 1000:g} s"


# --- interface ------------------------------------------------------------------------------------


def interface_text(chosen: ChosenTopics, name: str) -> str:
    """Return the interface of the robot."""
    comments, rows = [], list(_rows(chosen))
    if chosen.unused:
        comments = ["#", "# Topics that it does not use:", *(f"#   {line}" for line in unused_lines(chosen))]
    lines = [
        f"# {name}.colony - a robot on ROS 2, as its running graph showed it. Correct what is guessed.",
        "#",
        f"#   colony robot check {name}",
        f"#   colony serve all --robot {name} --hardware",
        f"#   colony shadow wander --robot {name} --duration 60        in another terminal: commands nothing",
        *comments,
        "",
        "language 1",
        "",
        'import "functions" as shared',
        "",
        f"robot {name} {{",
        "  frame    50 ms",
        *_sensor_lines(rows),
        "",
        f"  # guessed: the highest speeds, here and in {name}.toml",
        *drive_lines(VELOCITY_M_S, TURN_RAD_S),
        "}",
        *(_safety_lines(chosen, chosen.scan) if chosen.scan is not None else ()),
    ]
    return "\n".join(lines) + "\n"


def unused_lines(chosen: ChosenTopics) -> list[str]:
    """Return a line for each topic that the description does not use."""
    return [f"{chosen.relative(topic)} ({', '.join(topic.types)})" for topic in chosen.unused]


def _sensor_lines(rows: Iterable[_Row]) -> Iterator[str]:
    rows = list(rows)
    heads = [f"  sensor   {row.name} : {row.type}" for row in rows]
    width = max((len(head) for head in heads), default=0)
    parts = [max((len(row[i]) for row in rows), default=0) for i in (2, 3)]
    for head, row in zip(heads, rows, strict=True):
        if row.comment:
            yield f"  # {row.comment}"
        cells = (
            head.ljust(width),
            row.range.ljust(parts[0]),
            f"from {row.source.ljust(parts[1])}",
            row.within,
        )
        yield "  ".join(cell for cell in cells if cell).rstrip()


def _rows(chosen: ChosenTopics) -> Iterator[_Row]:
    if (scan := chosen.scan) is not None:
        elements = scan.elements
        bearings = f"bearing {elements.first_deg:g} deg step {elements.step_deg:g} deg"
        type_ = f"m   {bearings}"
        within = _within(scan.topic)
        yield _Row(f"ranges[{elements.count}]", type_, f"range 0 .. {scan.range_m:g}", "Lidar.scan", within)
    if (odom := chosen.odom) is not None:
        within = _within(odom)
        touched = "" if _bumpers(chosen) else "no bumper was found: both are always false"
        yield _Row("front_bumper", "bool", "", "RServer.front_bumper", within, touched)
        yield _Row("rear_bumper", "bool", "", "RServer.rear_bumper", within)
        yield from (_Row(axis, "m", "", f"RServer.{axis}", within) for axis in ("x", "y"))
        yield _Row("heading", "deg", "range 0 .. 360", "RServer.heading", within)
        yield _Row("speed", "m/s", "", "RServer.speed", within)
    if (imu := chosen.imu) is not None:
        yield _Row("turn_rate", "rad/s", "", "Imu.turn_rate", _within(imu))
        if _has_orientation(imu):
            yield _Row("gyro_heading", "deg", "range 0 .. 360", "Imu.heading", _within(imu))
    if (battery := chosen.battery) is not None:
        if _has_percentage(battery):
            yield _Row("battery", "percent", "range 0 .. 100", "Battery.level", _within(battery))
        else:
            yield _Row("voltage", "V", "", "Battery.voltage", _within(battery))
    for name, topic in _sensors_of_values(chosen).items():
        type_ = "bool" if topic.types == (BOOL,) else "number" if topic.types[0] in NUMBERS else "m"
        unit = "guessed: a number without a unit" if topic.types[0] in NUMBERS else ""
        yield _Row(name, type_, "", f"Values.{name}", _within(topic), unit)
    yield _Row(
        "docked_at", "number", "default 0", "DServer.DockedAt", "", "what a dock may say, and `wander` reads"
    )


def _safety_lines(chosen: ChosenTopics, scan: ChosenScan) -> Iterator[str]:
    """Yield what behaviors for any robot read of this one, and the limit of its speed."""
    elements = scan.elements
    felt = " and fresh(front_bumper) and fresh(rear_bumper)" if chosen.odom is not None else ""
    low, high = -60.0, 60.0
    if not elements.is_full:
        low, high = max(low, elements.first_deg), min(high, elements.last_deg)
    yield from ("", "# Whether the robot can see and feel.", f"let sensing = fresh(ranges){felt}")
    if low >= high:
        yield from ("", "# The scan does not look ahead, so that no limit follows from it.")
        return
    reach = radius_mm(chosen) - 1000.0 * scan.x_m + CLEARANCE_MM
    yield from (
        "",
        "# guessed: how near the scanner may come to an echo ahead, and the time for that.",
        f"param margin = {_up(reach, 10):g} mm",
        f"param reaction = {REACTION_S:g} s",
        f"let fastest_ahead = shared.fastest(ranges[{low:g} deg .. {high:g} deg], margin, reaction)",
        "",
        "limit drive.velocity <= fastest_ahead",
    )
    if chosen.odom is not None:
        yield "limit drive.velocity <= 0 m/s when front_bumper"
        yield "limit drive.velocity >= 0 m/s when rear_bumper"
    yield ""
    yield "contract brakes_in_time: fresh(ranges) implies drive.velocity <= fastest_ahead"


# --- body -----------------------------------------------------------------------------------------


def body_text(chosen: ChosenTopics, name: str, node: Mapping[str, str | int]) -> str:
    """Return the body of the robot; `node` has the keys of `[ros2]` that were given."""
    hull, wheels = chosen.hull_m, chosen.wheel_base_m
    shape = "of the collision geometry in /robot_description" if hull else "guessed: no URDF has it"
    lines = [
        f"# {name}.toml - the body of {name}: its shape, its drive, and its topics.",
        "",
        "[robot]",
        f'name = "{name}"',
        "",
        f"# The footprint is {shape}. guessed: a differential drive, and the limits.",
        "[body]",
        *chassis_lines(
            radius_mm=radius_mm(chosen),
            height_mm=None if hull is None or hull[1] < 0.05 else _up(1000.0 * hull[1], 10),
            wheel_base_mm=None if wheels is None else round(1000.0 * wheels),
            velocity_m_s=VELOCITY_M_S,
            turn_rad_s=TURN_RAD_S,
        ),
        "",
        "[ros2]",
        *(f"{key} = {json.dumps(value)}" for key, value in node.items()),
        *(["use_sim_time = true     # /clock has the time of a simulation"] if chosen.is_simulated else ()),
        *_base_lines(chosen),
    ]
    server = ""
    for topic in _topics(chosen):
        if topic.server != server:
            server = topic.server
            lines += ["", *([f"# {topic.comment}"] if topic.comment else ()), f"[server.{server}]"]
            if server == "Lidar" and chosen.scan is not None:
                lines.append(f'fields.scan = {{ no_echo = "{chosen.scan.range_m:g} m", invalid = "hold" }}')
        keys = ", ".join(f"{key} = {value}" for key, value in topic.keys.items())
        lines.append(f"ros2.{topic.field} = {{ {keys} }}")
    return "\n".join(_aligned(lines)) + "\n"


def radius_mm(chosen: ChosenTopics) -> float:
    """Return the radius of the hull in mm."""
    return RADIUS_MM if chosen.hull_m is None else max(_up(1000.0 * chosen.hull_m[0], 5), 20.0)


def _base_lines(chosen: ChosenTopics) -> Iterator[str]:
    odom, drive = chosen.odom, chosen.drive
    yield from ("", "# `alone` commands nothing beside another publisher, such as Nav2 or a teleoperation.")
    if drive is None:
        yield "# guessed: the topic of the drive, to which no node subscribes."
    if odom is None:
        yield "# No odometry was found: `RServer` drives, and measures nothing."
    yield "[server.RServer]"
    yield from base_lines(
        odom=None if odom is None else chosen.relative(odom),
        drive="cmd_vel" if drive is None else chosen.relative(drive),
    )
    for name, topic in _bumpers(chosen).items():
        yield f'ros2.{name} = {{ topic = "{chosen.relative(topic)}", type = "{BOOL}" }}'


def _text(text: str) -> str:
    """Return a text of a message as TOML writes it, in one line whatever it has."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _topics(chosen: ChosenTopics) -> Iterator[_Topic]:
    def of(topic: SurveyedTopic, **keys: str) -> dict[str, str]:
        return {"topic": f'"{chosen.relative(topic)}"', "type": f'"{topic.types[0]}"', **keys}

    if (scan := chosen.scan) is not None:
        place = f'["{_mm(scan.x_m)} mm", "{_mm(scan.y_m)} mm", "{scan.bearing_deg:g} deg"]'
        keys = {"frame": _text(scan.frame), "pose": place} if scan.frame else {"pose": place}
        keys |= {"upside_down": "true"} if scan.is_upside_down else {}
        keys |= {"zero": '"no_echo"'} if scan.has_zeros else {}
        guesses = (
            []
            if scan.is_placed
            else [f"the scanner is at the center, ahead: no transform from {_text(chosen.base)}"]
        )
        guesses += ["a range of 0 is no echo"] if scan.has_zeros else []
        comment = f"guessed: {'; '.join(guesses)}." if guesses else ""
        yield _Topic("Lidar", "scan", of(scan.topic, **keys), comment)
    if (imu := chosen.imu) is not None:
        yield _Topic("Imu", "turn_rate", of(imu, path='"angular_velocity.z"'))
        if _has_orientation(imu):
            yield _Topic("Imu", "heading", of(imu, path='"orientation.heading"'))
    if (battery := chosen.battery) is not None:
        newest = battery.newest
        if not _has_percentage(battery):
            yield _Topic("Battery", "voltage", of(battery, path='"voltage"'), "It sends no percentage.")
        elif newest is not None and newest["percentage"] > 1.0:
            comment = f"guessed: {newest['percentage']:.4g} is in percent, where ROS has a part of 1."
            yield _Topic("Battery", "level", of(battery, unit='"percent"'), comment)
        else:
            yield _Topic("Battery", "level", of(battery))
    for name, topic in _sensors_of_values(chosen).items():
        yield _Topic("Values", name, of(topic))


def _aligned(lines: Iterable[str]) -> Iterator[str]:
    """Yield lines whose topics are aligned by their equals signs, in each block."""
    lines = list(lines)
    for i, line in enumerate(lines):
        if not line.startswith(("ros2.", "fields.")):
            yield line
            continue
        first = i
        while lines[first - 1].startswith(("ros2.", "fields.")):
            first -= 1
        block = []
        for other in lines[first:]:
            if not other.startswith(("ros2.", "fields.")):
                break
            block.append(other.partition(" = ")[0].rstrip())
        key, _, value = line.partition(" = ")
        yield f"{key.rstrip().ljust(max(map(len, block)))} = {value}"


# --- what messages have ---------------------------------------------------------------------------

_BUMPERS = ("bumper", "front_bumper", "rear_bumper")


def _bumpers(chosen: ChosenTopics) -> dict[str, SurveyedTopic]:
    """Return the topics of bumpers, which are fields of the base."""
    found: dict[str, SurveyedTopic] = {}
    for topic in chosen.values.values() if chosen.odom is not None else ():
        last = topic.name.rpartition("/")[2]
        if topic.types == (BOOL,) and last in _BUMPERS:
            found.setdefault(last, topic)
    return found


def _sensors_of_values(chosen: ChosenTopics) -> dict[str, SurveyedTopic]:
    bumpers = list(_bumpers(chosen).values())
    return {name: topic for name, topic in chosen.values.items() if topic not in bumpers}


def _has_percentage(battery: SurveyedTopic) -> bool:
    newest = battery.newest
    return newest is None or (math.isfinite(newest["percentage"]) and newest["percentage"] >= 0.0)


def _has_orientation(imu: SurveyedTopic) -> bool:
    newest = imu.newest
    if newest is None:
        return False
    norm = math.hypot(*[newest["orientation"][key] for key in "xyzw"])
    return 0.5 <= norm <= 2.0 and newest["orientation_covariance"][0] != -1.0


def _up(value: float, step: float) -> float:
    """Return a value, rounded up to a multiple of `step`."""
    return math.ceil(value / step - 1e-6) * step


def _mm(meters: float) -> str:
    return f"{round(1000.0 * meters) + 0:g}"
