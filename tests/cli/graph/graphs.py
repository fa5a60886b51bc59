"""Graphs of ROS 2 as a survey finds them, with messages as their types have them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from colony.ir.ros2_messages import (
    BATTERY_STATE,
    IMU,
    LASER_SCAN,
    ODOMETRY,
    STANDARD,
    STRING,
    TRANSFORMS,
    TWIST,
)
from colony.ros2.cdr import decode, encode, structure
from colony.ros2.graph import End
from colony.ros2.survey import SurveyedTopic

URDF = """<robot name="rover">
  <link name="base_footprint"/>
  <link name="base_link">
    <collision><origin xyz="-0.032 0 0.070"/><geometry><box size="0.140 0.140 0.143"/></geometry></collision>
    <collision><geometry><mesh filename="package://a/b.stl"/></geometry></collision>
  </link>
  <joint name="base_joint" type="fixed">
    <parent link="base_footprint"/><child link="base_link"/><origin xyz="0 0 0.010"/>
  </joint>
  <joint name="wheel_left_joint" type="continuous">
    <parent link="base_link"/><child link="wheel_left_link"/><origin xyz="0 0.08 0.023" rpy="-1.57 0 0"/>
  </joint>
  <joint name="wheel_right_joint" type="continuous">
    <parent link="base_link"/><child link="wheel_right_link"/><origin xyz="0 -0.08 0.023" rpy="-1.57 0 0"/>
  </joint>
  <joint name="caster_wheel" type="continuous">
    <parent link="base_link"/><child link="caster"/><origin xyz="-0.1 0.3 0"/>
  </joint>
  <joint name="scan_joint" type="fixed">
    <parent link="base_link"/><child link="base_scan"/><origin xyz="-0.032 0 0.172" rpy="0 0 0"/>
  </joint>
</robot>"""


def end(node: str, type_: str, *, is_reliable: bool = True) -> End:
    return End(node, "/", type_, is_reliable, False)


def topic(
    name: str,
    type_: str,
    values: Mapping[str, Any] | None = None,
    *,
    rate_hz: float | None = 20.0,
    subscribers: int = 0,
    publishers: int = 1,
) -> SurveyedTopic:
    """Return a topic whose newest message has these values, and zeros otherwise."""
    messages = ()
    if values is not None:
        kind = structure(type_, STANDARD)
        messages = (decode(kind, encode(kind, values)),)
    return SurveyedTopic(
        name=name,
        types=(type_,),
        publishers=tuple(end(f"node{i}", type_) for i in range(publishers)),
        subscribers=tuple(end(f"hearer{i}", type_) for i in range(subscribers)),
        messages=messages,
        rate_hz=rate_hz,
    )


def scan(name: str = "/scan", frame: str = "base_scan", **values: Any) -> SurveyedTopic:
    """Return the scan of a full turn, of 360 beams."""
    given = {
        "header": {"frame_id": frame},
        "angle_increment": math.tau / 360,
        "range_min": 0.12,
        "range_max": 3.5,
        "ranges": [1.0] * 360,
        **values,
    }
    return topic(name, LASER_SCAN, given, rate_hz=5.0)


def odometry(name: str = "/odom") -> SurveyedTopic:
    return topic(name, ODOMETRY, {"child_frame_id": "base_footprint"})


def drive(name: str = "/cmd_vel", type_: str = TWIST, **ends: int) -> SurveyedTopic:
    return topic(name, type_, rate_hz=None, **{"subscribers": 1, "publishers": 0, **ends})


def turtlebot() -> list[SurveyedTopic]:
    """Return the graph of a TurtleBot3."""
    imu = {"orientation": {"w": 1.0}, "orientation_covariance": [0.0] * 9}
    return [
        scan(ranges=[1.0] * 359 + [0.0]),
        odometry(),
        drive(),
        topic("/battery_state", BATTERY_STATE, {"percentage": 75.0, "voltage": 12.0}, rate_hz=1.0),
        topic("/imu", IMU, imu),
        replace(topic("/joint_states", STRING), types=("sensor_msgs/msg/JointState",)),
        topic("/robot_description", STRING, {"data": URDF}, rate_hz=None),
        replace(topic("/tf", STRING), types=(TRANSFORMS,)),
        replace(topic("/rosout", STRING), types=("rcl_interfaces/msg/Log",)),
    ]


def transforms(*joints: tuple[str, str, Mapping[str, float], Mapping[str, float]]) -> SurveyedTopic:
    """Return /tf_static with joints: parent, child, translation, rotation."""
    found = [
        {
            "header": {"frame_id": parent},
            "child_frame_id": child,
            "transform": {"translation": place, "rotation": rotation},
        }
        for parent, child, place, rotation in joints
    ]
    return topic("/tf_static", TRANSFORMS, {"transforms": found}, rate_hz=None)
