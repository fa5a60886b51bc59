"""The messages of ROS 2 that most robots send and take: their definitions, as rclpy writes their types.

The bridge gives the definitions of all others, by the packages of the robot's ROS environment.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from colony.text.wording import did_you_mean, quoted

AUTO = "auto"
TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
TWISTS = (AUTO, TWIST, TWIST_STAMPED)
LASER_SCAN = "sensor_msgs/msg/LaserScan"
RANGE = "sensor_msgs/msg/Range"
BATTERY_STATE = "sensor_msgs/msg/BatteryState"
IMU = "sensor_msgs/msg/Imu"
ODOMETRY = "nav_msgs/msg/Odometry"
QUATERNION = "geometry_msgs/msg/Quaternion"
HEADER = "std_msgs/msg/Header"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
STRING = "std_msgs/msg/String"
BOOL = "std_msgs/msg/Bool"

DEFAULT_PATHS = {LASER_SCAN: "ranges", RANGE: "range", BATTERY_STATE: "percentage"}
"""The part of a message that a field has if the body names none; of all others it is `data`."""

DRIVE_PATHS = {"velocity": "linear.x", "sideways": "linear.y", "turn": "angular.z"}
"""The parts of a twist that parameters of these names set."""

AXES = ("linear.x", "linear.y", "linear.z", "angular.x", "angular.y", "angular.z")
"""The parts of a twist, in order."""

ANGLES = ("yaw", "pitch", "roll", "heading")
"""The angles that an orientation has besides its fields."""

_HEADER = ("header", "std_msgs/Header")
_XYZ = (("x", "double"), ("y", "double"), ("z", "double"))

STANDARD: dict[str, tuple[tuple[str, str], ...]] = {
    "builtin_interfaces/msg/Time": (("sec", "int32"), ("nanosec", "uint32")),
    HEADER: (("stamp", "builtin_interfaces/Time"), ("frame_id", "string")),
    "std_msgs/msg/Empty": (),
    BOOL: (("data", "boolean"),),
    "std_msgs/msg/Float32": (("data", "float"),),
    "std_msgs/msg/Float64": (("data", "double"),),
    "std_msgs/msg/Int32": (("data", "int32"),),
    STRING: (("data", "string"),),
    "geometry_msgs/msg/Vector3": _XYZ,
    "geometry_msgs/msg/Point": _XYZ,
    QUATERNION: (*_XYZ, ("w", "double")),
    "geometry_msgs/msg/Pose": (
        ("position", "geometry_msgs/Point"),
        ("orientation", "geometry_msgs/Quaternion"),
    ),
    "geometry_msgs/msg/Transform": (
        ("translation", "geometry_msgs/Vector3"),
        ("rotation", "geometry_msgs/Quaternion"),
    ),
    "geometry_msgs/msg/TransformStamped": (
        _HEADER,
        ("child_frame_id", "string"),
        ("transform", "geometry_msgs/Transform"),
    ),
    TRANSFORMS: (("transforms", "sequence<geometry_msgs/TransformStamped>"),),
    "geometry_msgs/msg/PoseWithCovariance": (("pose", "geometry_msgs/Pose"), ("covariance", "double[36]")),
    "geometry_msgs/msg/PoseStamped": (_HEADER, ("pose", "geometry_msgs/Pose")),
    "geometry_msgs/msg/PointStamped": (_HEADER, ("point", "geometry_msgs/Point")),
    TWIST: (("linear", "geometry_msgs/Vector3"), ("angular", "geometry_msgs/Vector3")),
    TWIST_STAMPED: (_HEADER, ("twist", "geometry_msgs/Twist")),
    "geometry_msgs/msg/TwistWithCovariance": (("twist", "geometry_msgs/Twist"), ("covariance", "double[36]")),
    ODOMETRY: (
        _HEADER,
        ("child_frame_id", "string"),
        ("pose", "geometry_msgs/PoseWithCovariance"),
        ("twist", "geometry_msgs/TwistWithCovariance"),
    ),
    LASER_SCAN: (
        _HEADER,
        ("angle_min", "float"),
        ("angle_max", "float"),
        ("angle_increment", "float"),
        ("time_increment", "float"),
        ("scan_time", "float"),
        ("range_min", "float"),
        ("range_max", "float"),
        ("ranges", "sequence<float>"),
        ("intensities", "sequence<float>"),
    ),
    RANGE: (
        _HEADER,
        ("radiation_type", "uint8"),
        ("field_of_view", "float"),
        ("min_range", "float"),
        ("max_range", "float"),
        ("range", "float"),
        ("variance", "float"),
    ),
    IMU: (
        _HEADER,
        ("orientation", "geometry_msgs/Quaternion"),
        ("orientation_covariance", "double[9]"),
        ("angular_velocity", "geometry_msgs/Vector3"),
        ("angular_velocity_covariance", "double[9]"),
        ("linear_acceleration", "geometry_msgs/Vector3"),
        ("linear_acceleration_covariance", "double[9]"),
    ),
    BATTERY_STATE: (
        _HEADER,
        ("voltage", "float"),
        ("temperature", "float"),
        ("current", "float"),
        ("charge", "float"),
        ("capacity", "float"),
        ("design_capacity", "float"),
        ("percentage", "float"),
        ("power_supply_status", "uint8"),
        ("power_supply_health", "uint8"),
        ("power_supply_technology", "uint8"),
        ("present", "boolean"),
        ("cell_voltage", "sequence<float>"),
        ("cell_temperature", "sequence<float>"),
        ("location", "string"),
        ("serial_number", "string"),
    ),
    "sensor_msgs/msg/Joy": (_HEADER, ("axes", "sequence<float>"), ("buttons", "sequence<int32>")),
}
"""The fields of each message by the name of its type."""


# --- parts ----------------------------------------------------------------------------------------


def is_action(type_: str) -> bool:
    """Return True for the type of an action, or of a part of one."""
    return "/action/" in type_


_STEP = re.compile(r"(\w+)(?:\[(\d+)\])?")
_SEQUENCE = re.compile(r"sequence<(.+?)(?:, *\d+)?>|(.+)\[(\d+)\]")


def part_problem(type_: str, path: str, *, is_sent: bool = False) -> str | None:
    """Return why a message of a standard type has no value at a path, or None; None for all other types.

    Args:
        type_: the type, such as `sensor_msgs/msg/Imu`.
        path: the path, such as `orientation.yaw`.
        is_sent: True if the value is set, and not read: an orientation has no angles then, and an array
            no elements.
    """
    if type_ not in STANDARD:
        return None
    kind, done = type_, type_
    for step in path.split("."):
        found = _STEP.fullmatch(step)
        name, index = (found[1], found[2]) if found is not None else (step, None)
        fields = _fields(kind)
        if fields is None:
            return f"`{done}` is a `{kind}`, which has no parts"
        if kind == QUATERNION and name in ANGLES and not is_sent:
            fields = {**fields, **dict.fromkeys(ANGLES, "double")}
        if name not in fields:
            hint = did_you_mean(name, fields) or f"it has {quoted(list(fields), 'and')}"
            return f"{done} has no `{name}`: {hint}"
        done, kind = (name if done == type_ else f"{done}.{name}"), _full(fields[name])
        if index is not None:
            several = _SEQUENCE.fullmatch(kind)
            if several is None or is_sent:
                return f"`{done}` has no elements that can be {'set' if is_sent else 'read'} one by one"
            if several[3] is not None and int(index) >= int(several[3]):
                return f"`{done}` has {several[3]} elements, from 0"
            kind = _full(several[1] or several[2])
    if (fields := _fields(kind)) is not None:
        return f"`{done}` is a `{kind}`: name one of its fields, {quoted(list(fields), 'or')}"
    return None


def _fields(kind: str) -> Mapping[str, str] | None:
    """Return the fields of a message; None for a type without fields."""
    return dict(STANDARD[kind]) if kind in STANDARD else None


def _full(kind: str) -> str:
    """Return the full name of the type of a message, `PACKAGE/msg/NAME`; other types as they are."""
    package, _, name = kind.partition("/")
    return (
        f"{package}/msg/{name}" if name and "<" not in kind and "[" not in kind and "/" not in name else kind
    )
