"""Paths into the messages of ROS 2, checked against their definitions."""

from __future__ import annotations

import pytest

from colony.ir.ros2_messages import BATTERY_STATE, IMU, ODOMETRY, STANDARD, TWIST_STAMPED, part_problem

JOY = "sensor_msgs/msg/Joy"


@pytest.mark.parametrize(
    ("type_", "path"),
    [
        (IMU, "orientation.yaw"),
        (IMU, "angular_velocity.z"),
        (ODOMETRY, "pose.pose.orientation.heading"),
        (ODOMETRY, "pose.covariance[35]"),
        (BATTERY_STATE, "cell_voltage[9]"),
        (TWIST_STAMPED, "twist.linear.x"),
        (JOY, "axes"),
        ("lab_msgs/msg/Gas", "anything.at[7].all"),
    ],
)
def test_what_a_message_has(type_: str, path: str) -> None:
    assert part_problem(type_, path) is None


@pytest.mark.parametrize(
    ("type_", "path", "problem"),
    [
        (
            IMU,
            "angular_velocity",
            "`angular_velocity` is a `geometry_msgs/msg/Vector3`: name one of its fields",
        ),
        (IMU, "angular_velocity.yaw", "angular_velocity has no `yaw`: it has `x`, `y` and `z`"),
        (IMU, "data", f"{IMU} has no `data`: it has `header`"),
        (ODOMETRY, "pose.covariance[36]", "`pose.covariance` has 36 elements, from 0"),
        (JOY, "header.frame_id[0]", "`header.frame_id` has no elements that can be read one by one"),
        (JOY, "axes[0].x", "`axes` is a `float`, which has no parts"),
    ],
)
def test_what_a_message_lacks(type_: str, path: str, problem: str) -> None:
    assert problem in (part_problem(type_, path) or "")


def test_what_cannot_be_set() -> None:
    assert part_problem(IMU, "orientation.yaw", is_sent=True) is not None
    assert part_problem(JOY, "axes[0]", is_sent=True) is not None
    assert part_problem(IMU, "orientation.w", is_sent=True) is None


def test_all_definitions_name_types_that_are_known() -> None:
    assert [t for t in STANDARD if part_problem(t, "nothing") is None] == []
