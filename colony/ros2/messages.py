"""The definitions of the messages that most robots send and take, as rclpy writes their types.

The bridge gives the definitions of all others, by the packages of the robot's ROS environment.
"""

from __future__ import annotations

from colony.ros2.cdr import Definition

TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
LASER_SCAN = "sensor_msgs/msg/LaserScan"
RANGE = "sensor_msgs/msg/Range"
ODOMETRY = "nav_msgs/msg/Odometry"
QUATERNION = "geometry_msgs/msg/Quaternion"
HEADER = "std_msgs/msg/Header"

_HEADER = ("header", "std_msgs/Header")
_XYZ = (("x", "double"), ("y", "double"), ("z", "double"))

STANDARD: dict[str, Definition] = {
    "builtin_interfaces/msg/Time": (("sec", "int32"), ("nanosec", "uint32")),
    HEADER: (("stamp", "builtin_interfaces/Time"), ("frame_id", "string")),
    "std_msgs/msg/Empty": (),
    "std_msgs/msg/Bool": (("data", "boolean"),),
    "std_msgs/msg/Float32": (("data", "float"),),
    "std_msgs/msg/Float64": (("data", "double"),),
    "std_msgs/msg/Int32": (("data", "int32"),),
    "std_msgs/msg/String": (("data", "string"),),
    "geometry_msgs/msg/Vector3": _XYZ,
    "geometry_msgs/msg/Point": _XYZ,
    QUATERNION: (*_XYZ, ("w", "double")),
    "geometry_msgs/msg/Pose": (
        ("position", "geometry_msgs/Point"),
        ("orientation", "geometry_msgs/Quaternion"),
    ),
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
    "sensor_msgs/msg/Imu": (
        _HEADER,
        ("orientation", "geometry_msgs/Quaternion"),
        ("orientation_covariance", "double[9]"),
        ("angular_velocity", "geometry_msgs/Vector3"),
        ("angular_velocity_covariance", "double[9]"),
        ("linear_acceleration", "geometry_msgs/Vector3"),
        ("linear_acceleration_covariance", "double[9]"),
    ),
    "sensor_msgs/msg/BatteryState": (
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


def is_action(type_: str) -> bool:
    """Return True for the type of an action, or of a part of one."""
    return "/action/" in type_
