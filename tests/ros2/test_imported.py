"""A foreign robot of genuine ROS 2: described from its graph, checked, and shadowed without an edit."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest

from tests.cli.graph.graphs import URDF
from tests.cli.machine import Machine, failed
from tests.ros2.ros import Ros
from tests.waiting import until

pytestmark = pytest.mark.ros2

OTHERS = {
    "battery_state": ["sensor_msgs/msg/BatteryState", {"percentage": 75.0, "voltage": 12.0}, "reliable"],
    "imu": ["sensor_msgs/msg/Imu", {"orientation": {"w": 1.0}}, "reliable"],
    "joint_states": ["sensor_msgs/msg/JointState", {"name": ["left", "right"]}, "reliable"],
    "robot_description": ["std_msgs/msg/String", {"data": URDF}, "latched"],
}


@pytest.mark.parametrize("twist", ["Twist", "TwistStamped"])
def test_a_turtlebot_is_described_checked_and_shadowed(ros: Ros, tmp_path: Path, twist: str) -> None:
    robot = ros.foreign(others=OTHERS, twist=twist, frame="base_scan")
    with closing(Machine(tmp_path)) as machine:
        written = machine.run(
            *(
                "robot",
                "import",
                "ros2",
                "burger",
                "--python",
                str(ros.python),
                "-o",
                str(tmp_path / "robots"),
            )
        )
        assert written.wait() == 0, written.err
        assert "uses cmd_vel, odom, scan, battery_state, imu\n" in written.out
        assert "does not use joint_states (sensor_msgs/msg/JointState)\n" in written.out
        assert "note" not in written.out
        path = tmp_path / "robots" / "burger" / "burger.colony"
        checked = machine.run("robot", "check", str(path))
        assert (checked.out, checked.err) == (f"{path}: ok\n", "")
        body = path.with_suffix(".toml").read_text()
        assert 'pose = ["-32 mm", "0 mm", "0 deg"]' in body
        assert 'wheel_base = "160 mm"' in body
        assert not robot.heard
        named = f"burger={path}"
        served = machine.start("serve", "all", "--robot", named, "--hardware")
        until(
            lambda: failed(served) or "no program runs" in machine.run("ps", "--robot", "burger").out,
            "it is served",
        )
        shadow = machine.run("shadow", "wander", "--robot", named, "--duration", "3")
        assert shadow.wait() == 0, shadow.err
        assert all(row["v"] == row["w"] == 0.0 for row in robot.heard)
        until(robot.stands, "it was stopped at the start, and then left to others")


def test_an_empty_domain_and_a_python_without_rclpy_are_errors(ros: Ros, tmp_path: Path) -> None:
    with closing(Machine(tmp_path)) as machine:
        command = ("robot", "import", "ros2", "burger", "--seconds", "0.5", "--python")
        found = machine.run(*command, str(ros.python))
        assert found.wait() == 1
        assert "error: no robot in domain" in found.err
        found = machine.run(*command, "/usr/bin/python3")
        assert found.wait() == 1
        assert (
            "cannot look at ROS 2: /usr/bin/python3: ModuleNotFoundError: No module named 'rclpy'"
            in found.err
        )
