"""What a body says of a robot that runs ROS 2: its node, and the topics of its fields and commands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Literal

from colony.body.devices import MountPose
from colony.body.devices.common import CENTER, POSE, POSE_MEANING
from colony.body.kinds import (
    NAME,
    AllowedRange,
    Flag,
    Measure,
    NamedTables,
    TextKind,
    Whole,
    WordKind,
    entry,
)
from colony.ir.ros2_messages import (
    AUTO,
    BATTERY_STATE,
    DEFAULT_PATHS,
    DRIVE_PATHS,
    IMU,
    LASER_SCAN,
    ODOMETRY,
    RANGE,
    TWIST,
    TWIST_STAMPED,
    TWISTS,
)
from colony.text.units import NUMBER, TIME, Unit, UnitError, parse_unit

_TOPIC = r"[~/]?[A-Za-z_]\w*(?:/\w+)*"
_STEP = r"\w+(?:\[\d+\])?"
_PATH = TextKind(rf"{_STEP}(?:\.{_STEP})*", "a path such as `status.level` or `axes[1]`")
_FILE = TextKind(r"[^\0\n]+", "a path")

NAVIGATE_TO_POSE = "nav2_msgs/action/NavigateToPose"
MAX_DOMAIN = 232

DRIVE, ODOM = "drive", "odom"
BASE_NAMES = (DRIVE, ODOM, "bumper", "front_bumper", "rear_bumper")
"""The topics that `RServer` has: the twist that it commands, its odometry, and what touches it."""

STATUS = "status"
GOAL_STATES = ("idle", "sent", "executing", "succeeded", "canceled", "aborted", "rejected", "lost")
"""The field of an action that has the state of its goal, and the members of its enum."""

BASE_TYPES = {DRIVE: TWISTS, ODOM: (ODOMETRY,)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Ros2Node:
    """The node by which a robot takes part in ROS 2."""

    name: str = entry(
        "name", TextKind(NAME, "a name"), "the name of the node [default: that of the robot]", default=""
    )
    namespace: str = entry("namespace", TextKind(r"(?:/?\w+)*", "a namespace"), "its namespace", default="")
    domain: int | None = entry(
        "domain", Whole(0, MAX_DOMAIN), "the domain [default: that of ROS_DOMAIN_ID]", default=None
    )
    setup: str = entry(
        "setup",
        _FILE,
        "the script that sets up the ROS environment, such as /opt/ros/jazzy/setup.bash",
        default="",
    )
    python: str = entry("python", _FILE, "the Python that has rclpy [default: /usr/bin/python3]", default="")
    use_sim_time: bool = entry(
        "use_sim_time", Flag(), "true if the time is that of the topic /clock [default: false]", default=False
    )
    introspection: bool = entry(
        "introspection",
        Flag(),
        "false to keep the robot's services, diagnostics, winners and params from ROS [default: true]",
        default=True,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Ros2Topic:
    """The topic of a field or of a command of a server, or the action that is its command."""

    topic: str = entry(
        "topic",
        TextKind(_TOPIC, "the name of a topic"),
        "the topic, within the node's namespace",
        default="",
    )
    action: str = entry(
        "action",
        TextKind(_TOPIC, "the name of an action"),
        "the action, in the place of a topic; each command of the server is a goal",
        default="",
    )
    type: str = entry(
        "type",
        TextKind(r"auto|\w+/(?:msg|action)/\w+", "`PACKAGE/msg/NAME` or `PACKAGE/action/NAME`"),
        "the type of its messages; `auto` is Twist or TwistStamped, as the subscribers expect",
    )
    path: str | None = entry(
        "path",
        _PATH,
        "the part of the message that a field has [default: `ranges`, `range`, `percentage` or `data`]",
        default=None,
    )
    unit: str | None = entry(
        "unit",
        TextKind(r"\S+", "a unit such as `m/s`"),
        "the unit of its numbers [default: that of the type, or else that of the interface]",
        default=None,
    )
    frame: str = entry(
        "frame",
        TextKind(r"[\w/\-.]+", "a frame"),
        "the frame of its messages; others are refused. Of a command, the frame that it is stamped with "
        "[default for actions: map]",
        default="",
    )
    pose: MountPose = entry("pose", POSE, POSE_MEANING, default=CENTER)
    upside_down: bool = entry(
        "upside_down",
        Flag(),
        "true for a scanner whose angles grow clockwise, seen from above",
        default=False,
    )
    zero: Literal["invalid", "no_echo"] = entry(
        "zero",
        WordKind(("invalid", "no_echo")),
        "what a range of 0 means if the device does not measure down to it [default: invalid]",
        default="invalid",
    )
    qos: Literal["best_effort", "reliable", "latched"] | None = entry(
        "qos",
        WordKind(("best_effort", "reliable", "latched")),
        "its quality of service [default: best_effort for fields, reliable for commands]",
        default=None,
    )
    timeout_s: float | None = entry(
        "timeout",
        Measure(TIME, "250 ms", AllowedRange(low=0.05, high=10.0)),
        "time without a decision after which the bridge stops it [default: 250 ms, or three frames]",
        default=None,
    )
    alone: bool = entry(
        "alone", Flag(), "true to command nothing beside another publisher [default: false]", default=False
    )
    stop: Literal["zero", "keep"] | None = entry(
        "stop",
        WordKind(("zero", "keep")),
        "its stop: a message of zeros, or none [default: zero for twists, else keep]",
        default=None,
    )
    parameters: Mapping[str, str] = entry(
        "parameters",
        NamedTables(_PATH),
        "the part of the message that each parameter sets [default: `data`, or the part of its name]",
        default={},
    )
    feedback: Mapping[str, str] = entry(
        "feedback",
        NamedTables(_PATH),
        "the part of the feedback that each field of the server is [default: the part of its name]",
        default={},
    )

    @property
    def name(self) -> str:
        """The name of the topic or action."""
        return self.topic or self.action


_TWIST_UNITS = (("linear", "m/s"), ("angular", "rad/s"))


def _within(path: str, units: Iterable[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    return tuple((f"{path}.{part}", unit) for part, unit in units)


UNITS: Mapping[str, tuple[tuple[str, str], ...]] = {
    LASER_SCAN: (("ranges", "m"), ("range_min", "m"), ("range_max", "m"), ("angle", "rad")),
    RANGE: (("range", "m"), ("min_range", "m"), ("max_range", "m"), ("field_of_view", "rad")),
    AUTO: _TWIST_UNITS,
    TWIST: _TWIST_UNITS,
    TWIST_STAMPED: _within("twist", _TWIST_UNITS),
    ODOMETRY: (
        ("pose.pose.position", "m"),
        ("pose.pose.orientation", "rad"),
        *_within("twist.twist", _TWIST_UNITS),
    ),
    "geometry_msgs/msg/PointStamped": (("point", "m"),),
    "geometry_msgs/msg/PoseStamped": (("pose.position", "m"), ("pose.orientation", "rad")),
    IMU: (
        ("orientation", "rad"),
        ("angular_velocity", "rad/s"),
        ("linear_acceleration", "m/s^2"),
    ),
    BATTERY_STATE: (
        ("voltage", "V"),
        ("temperature", "degC"),
        ("current", "A"),
        ("charge", "Ah"),
        ("capacity", "Ah"),
        ("design_capacity", "Ah"),
        ("cell_voltage", "V"),
        ("cell_temperature", "degC"),
        ("percentage", "number"),
    ),
    "sensor_msgs/msg/Temperature": (("temperature", "degC"),),
    NAVIGATE_TO_POSE: (
        ("pose.pose.position", "m"),
        ("pose.pose.orientation", "rad"),
        ("current_pose.pose.position", "m"),
        ("current_pose.pose.orientation", "rad"),
        ("distance_remaining", "m"),
        ("navigation_time.sec", "s"),
        ("estimated_time_remaining.sec", "s"),
    ),
}
"""The units of the parts of standard messages, each by how its path begins."""


GOAL_PATHS = {
    NAVIGATE_TO_POSE: {
        "x": "pose.pose.position.x",
        "y": "pose.pose.position.y",
        "heading": "pose.pose.orientation.heading",
    }
}
"""The parts of a goal that parameters of these names set, by the type of the action."""


def action_of(topics: Mapping[str, Ros2Topic]) -> tuple[str, Ros2Topic] | None:
    """Return the command of a server that is an action, and the action; None without one."""
    return next(((name, topic) for name, topic in topics.items() if topic.action), None)


def field_topic(topics: Mapping[str, Ros2Topic], field: str) -> Ros2Topic | None:
    """Return the topic of a field of a server: its own, or the action of the server with its part of it."""
    action = action_of(topics)
    if field in topics or action is None:
        return topics.get(field)
    return replace(action[1], path=action[1].feedback.get(field, field))


def path_of(topic: Ros2Topic) -> str:
    """Return the part of a message that a field has."""
    return topic.path or DEFAULT_PATHS.get(topic.type, "data")


def is_scan(topic: Ros2Topic) -> bool:
    """Return True for a field that has the ranges of a laser scanner."""
    return topic.type == LASER_SCAN and path_of(topic) == DEFAULT_PATHS[LASER_SCAN]


def parameter_path(topic: Ros2Topic, parameter: str) -> str:
    """Return the part of a message that a parameter sets."""
    known = GOAL_PATHS.get(topic.type, {}) if topic.action else DRIVE_PATHS
    return topic.parameters.get(parameter) or known.get(parameter, parameter)


def unit_of(topic: Ros2Topic, path: str) -> Unit | None:
    """Return the unit of a part of a message: the one that the body gives, or that of the type, if any.

    Raises:
        UnitError: the body gives none of the language.
    """
    if topic.unit is not None:
        return _unit(topic.unit)
    known = (u for prefix, u in UNITS.get(topic.type, ()) if path.startswith(prefix))
    text = next(known, None)
    return None if text is None else _unit(text)


def _unit(text: str) -> Unit:
    """Return a unit; `number` is that of numbers without one, such as 0.75 of a whole."""
    return Unit(text, NUMBER, Fraction(1)) if text == "number" else parse_unit(text)


def unit_problem(topic: Ros2Topic) -> str | None:
    """Return what is wrong with the unit that the body gives, or None."""
    try:
        unit_of(topic, "")
    except UnitError as problem:
        return str(problem)
    return None
