"""Descriptions of robots from their graphs: they pass the check, and each guess has a comment."""

from __future__ import annotations

import os
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from colony.body.disagreements import findings
from colony.body.model import Body
from colony.body.reader import body_of_text
from colony.cli.robot.graph.choice import choose
from colony.cli.robot.graph.description import body_text, interface_text, within_ms
from colony.dsl.load import check_file, check_text
from colony.ir.program import Robot
from colony.ir.ros2_messages import BATTERY_STATE, BOOL, IMU, LASER_SCAN, ODOMETRY, RANGE
from colony.ros2.survey import SurveyedTopic
from tests.cli.graph.graphs import drive, odometry, scan, topic, transforms, turtlebot
from tests.paths import ROOT

ROLLED = {"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0}
WITHOUT_SCAN = [odometry(), drive()]


def described(graph: list[SurveyedTopic], **node: Any) -> tuple[str, str, Robot, Body]:
    """Return interface and body of a graph, which agree without a word."""
    chosen = choose(graph)
    interface, body = interface_text(chosen, "rover"), body_text(chosen, "rover", node)
    checked, file = check_text(interface), body_of_text(body, "rover.toml")
    assert checked.diagnostics == (), interface
    assert checked.program is not None
    assert file.body is not None, body
    assert findings(checked.program.robot, file) == (), body
    return interface, body, checked.program.robot, file.body


GRAPHS: dict[str, list[SurveyedTopic]] = {
    "turtlebot": turtlebot(),
    "bare base": WITHOUT_SCAN,
    "drive alone": [drive()],
    "scan alone": [scan()],
    "scan ahead": [scan(angle_min=-1.0, angle_increment=0.01, ranges=[1.0] * 200), *WITHOUT_SCAN],
    "scan to the left": [scan(angle_min=1.2, angle_increment=0.01, ranges=[1.0] * 150), *WITHOUT_SCAN],
    "scan upside down": [
        transforms(("base_footprint", "base_scan", {"x": 0.1, "y": 0.02, "z": 0.2}, ROLLED)),
        scan(angle_min=-1.0, angle_increment=0.01, ranges=[1.0] * 300),
        *WITHOUT_SCAN,
    ],
    "voltage alone": [*WITHOUT_SCAN, topic("/battery", BATTERY_STATE, {"percentage": float("nan")})],
    "orientation unknown": [
        *WITHOUT_SCAN,
        topic("/imu", IMU, {"orientation_covariance": [-1.0, *[0.0] * 8]}),
    ],
    "values": [
        *WITHOUT_SCAN,
        topic("/front_bumper", BOOL),
        topic("/sonar/left", RANGE),
        topic("/is", BOOL),
        topic("/ranges", BOOL),
        topic("/gas", "std_msgs/msg/Float64"),
    ],
    "simulated": [*turtlebot(), replace(topic("/clock", BOOL), types=("rosgraph_msgs/msg/Clock",))],
}


@pytest.mark.parametrize("graph", GRAPHS.values(), ids=GRAPHS)
def test_what_is_written_passes_the_check(graph: list[SurveyedTopic]) -> None:
    interface, body, robot, _ = described(graph)
    assert robot.name == "rover"
    assert max(map(len, interface.splitlines())) <= 115
    assert "guessed: " in interface
    assert "guessed: " in body


def test_a_turtlebot_has_its_units_mounting_and_ages() -> None:
    interface, body, robot, read = described(turtlebot(), python="/ros/python", domain=7)
    sensors = {sensor.name: sensor for sensor in robot.sensors}
    assert sensors["ranges"].within_ns == 500_000_000  # two and a half of 5 Hz
    assert sensors["battery"].within_ns == 3_000_000_000
    assert "#   joint_states (sensor_msgs/msg/JointState)\n" in interface
    assert (read.ros2.python, read.ros2.domain, read.ros2.use_sim_time) == ("/ros/python", 7, False)
    taken = read.servers["Lidar"].ros2["scan"]
    assert (taken.pose.x_mm, taken.frame, taken.zero) == (-32.0, "base_scan", "no_echo")
    assert read.servers["Battery"].ros2["level"].unit == "percent"
    assert read.servers["RServer"].ros2["drive"].alone
    assert (read.chassis.drive.wheel_base_mm, read.chassis.height_mm) == (160.0, 160.0)
    assert "# guessed: a range of 0 is no echo." in body
    assert "# guessed: 75 is in percent, where ROS has a part of 1." in body


@pytest.mark.parametrize(
    "frame", ['x" }\n[server.Evil]\n# ', "back\\slash", "\x00\x7f\x1b[31m", "caf\u00e9 \U0001f916"]
)
def test_frames_are_texts_whatever_they_contain(frame: str) -> None:
    odom = topic("/odom", ODOMETRY, {"child_frame_id": f"base {frame}"})
    body = tomllib.loads(body_text(choose([scan(frame=frame), odom, drive()]), "rover", {}))
    assert set(body["server"]) == {"RServer", "Lidar"}
    assert body["server"]["Lidar"]["ros2"]["scan"]["frame"] == frame


def test_behaviors_that_come_with_colony_run_on_a_turtlebot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    interface, body, _, _ = described(turtlebot())
    (tmp_path / "rover.colony").write_text(interface)
    (tmp_path / "rover.toml").write_text(body)
    monkeypatch.chdir(tmp_path)
    for behavior in ("wander", "follow_wall"):
        path = ROOT / "behaviors" / f"{behavior}.colony"
        assert check_file(path, robot=os.fspath(tmp_path / "rover.colony")).diagnostics == ()


def test_columns_are_aligned() -> None:
    interface, body, _, _ = described(turtlebot())
    columns = {line.index(" from ") for line in interface.splitlines() if line.startswith("  sensor")}
    assert len(columns) == 1
    imu = body.partition("[server.Imu]\n")[2].splitlines()[:2]
    assert {line.index(" = ") for line in imu} == {len("ros2.turn_rate")}


@pytest.mark.parametrize(
    ("rate_hz", "ms"), [(None, 2000), (20.0, 300), (5.0, 500), (1.0, 3000), (0.1, 30_000), (0.001, 60_000)]
)
def test_a_message_counts_for_two_and_a_half_periods(rate_hz: float | None, ms: int) -> None:
    assert within_ms(topic("/a", LASER_SCAN, rate_hz=rate_hz)) == ms
