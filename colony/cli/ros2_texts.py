"""The texts of robots on ROS 2 that colony writes: parts of their interfaces and bodies."""

from __future__ import annotations

from colony.dsl.syntax_errors import RESERVED

TAKEN = RESERVED | {"idle", "last", "restarted", "frame_period", "drive", "fastest", "fastest_turn"}
"""Names that a sensor of a topic cannot have."""

ODOM_TYPE = "nav_msgs/msg/Odometry"


def drive_lines(velocity_m_s: float, turn_rad_s: float) -> list[str]:
    """Return the lines of an interface that declare the actuator of a base."""
    velocity, turn = f"-{velocity_m_s:g} .. {velocity_m_s:g}", f"-{turn_rad_s:g} .. {turn_rad_s:g}"
    return [
        f"  actuator drive {{ velocity : m/s range {velocity}, turn : rad/s range {turn} }}",
        "           to RServer.drive    idle drive(velocity = 0, turn = 0)",
    ]


def chassis_lines(
    *,
    radius_mm: float,
    velocity_m_s: float,
    turn_rad_s: float,
    wheel_base_mm: float | None = None,
    height_mm: float | None = None,
) -> list[str]:
    """Return the lines of a body from `footprint` to the accelerations, which are guessed."""
    wheels = "" if wheel_base_mm is None else f', wheel_base = "{wheel_base_mm:g} mm"'
    return [
        f'footprint = {{ shape = "circle", radius = "{radius_mm:g} mm" }}',
        *([] if height_mm is None else [f'height    = "{height_mm:g} mm"']),
        f'drive     = {{ kind = "differential"{wheels} }}',
        "",
        "[body.limits]",
        f'velocity          = "{velocity_m_s:g} m/s"',
        f'turn              = "{turn_rad_s:g} rad/s"',
        'acceleration      = "1 m/s^2"',
        f'turn_acceleration = "{2 * turn_rad_s:g} rad/s^2"',
    ]


def base_lines(*, odom: str | None = "odom", drive: str = "cmd_vel") -> list[str]:
    """Return the lines of a body with the topics of the base; None for a base without odometry."""
    found = [] if odom is None else [f'ros2.odom  = {{ topic = "{odom}", type = "{ODOM_TYPE}" }}']
    return [*found, f'ros2.drive = {{ topic = "{drive}", type = "auto", alone = true }}']
