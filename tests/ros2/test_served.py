"""A robot whose body is topics of ROS 2 alone, served and driven as any other."""

from __future__ import annotations

import os
import shutil
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path

import pytest

from colony.runtime.library.leader import LEADER
from colony.runtime.transport.live.run_directory import RunDirectory
from tests.cli.machine import Machine, contracts_held, failed
from tests.paths import ROOT
from tests.ros2 import burger
from tests.ros2.ros import Foreign, Ros
from tests.waiting import until

pytestmark = pytest.mark.ros2

STOPPED_NS = 300_000_000
"""Longest time from the death of a process to the first zero."""


class Served:
    """The foreign robot, served, and driven by a program. Mutable: its processes."""

    def __init__(self, ros: Ros, folder: Path, *options: str, walks: bool = False) -> None:
        self.machine = Machine(folder)
        program = burger.write(folder, ros.python, walks=walks)
        self.robot: Foreign = ros.foreign(others=burger.OTHERS, hears={"lamp": "std_msgs/msg/Float64"})
        named = f"burger={folder / 'robots' / 'burger' / 'burger.colony'}"
        self.recording = str(folder / "run.mcap")
        self.supervisor = self.machine.start("serve", "all", "--robot", named, "--hardware")
        until(lambda: failed(self.supervisor) or "RServer" in self._running(), "it is served")
        self.leader = self.machine.start(
            "drive", str(program), "--robot", named, "--record", self.recording, *options
        )

    def _running(self) -> dict[str, int]:
        return dict(RunDirectory.find(self.machine.environment).robot("burger").running())

    def pid(self, server: str) -> int:
        """Return the process id of a server, or of the program."""
        return self.leader.pid if server == LEADER else self._running()[server]

    def drives(self) -> bool:
        """Return True while the robot is commanded to move."""
        failed(self.supervisor, self.leader)
        return self.robot.drives()


@pytest.fixture
def served(ros: Ros, tmp_path: Path) -> Iterator[Served]:
    with ExitStack() as stack:
        found = Served(ros, tmp_path)
        stack.enter_context(closing(found.machine))
        until(found.drives, "it drives")
        yield found


def test_a_robot_of_topics_alone_is_driven_by_a_behavior(served: Served) -> None:
    robot = served.robot
    until(lambda: any(row["w"] == 1.0 for row in list(robot.heard)), "it turns before the wall")
    until(lambda: {"data": 0.5} in robot.others.get("lamp", []), "the lamp shines")
    until(served.drives, "it drives on")
    for name, value in (("estop", {"data": True}), ("mode", {"data": "manual"})):
        robot.set(others={**burger.OTHERS, name: [burger.OTHERS[name][0], value, "reliable"]})
        until(lambda: robot.heard[-1]["v"] == 0.0 == robot.heard[-1]["w"], f"{name} holds it")
        robot.set(others=burger.OTHERS)
        until(served.drives, "it drives on")
    served.leader.interrupt()
    assert contracts_held(served.leader.out), served.leader.out
    until(robot.stands, "it stands, and others may drive it")
    assert not robot.heard[-1]["touched"]
    assert served.machine.run("audit", served.recording).wait() == 0
    served.supervisor.interrupt()
    until(robot.stands, "ten zeros, and silence")


@pytest.mark.parametrize("server", ["RServer", "Clock", LEADER])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_robot_hears_zero_when_a_process_dies_or_freezes(
    served: Served, server: str, number: signal.Signals
) -> None:
    pid, began_ns = served.pid(server), time.monotonic_ns()
    os.kill(pid, number)
    until(lambda: any(not r["v"] and not r["w"] for r in served.robot.since(began_ns)), "a zero")
    first = next(r for r in served.robot.since(began_ns) if not r["v"] and not r["w"])
    if number == signal.SIGSTOP:
        os.kill(pid, signal.SIGCONT)
    assert first["t"] - began_ns < STOPPED_NS
    if server == LEADER and number == signal.SIGKILL:
        until(served.robot.stands, "it stands, since the program is gone")
    else:
        until(served.drives, "it drives again")


def test_a_second_publisher_is_named_by_the_supervisor(served: Served) -> None:
    served.robot.set(second="Twist")
    line = "RServer fails: `/foreign` publishes /cmd_vel as well (geometry_msgs/msg/Twist)"
    until(lambda: line in served.supervisor.err, line)
    assert "publishes /cmd_vel as well" in served.machine.run("ps", "--robot", "burger").out
    served.robot.set(second=None)
    until(lambda: "RServer works again" in served.supervisor.err, "it is alone again")


def test_the_goals_of_a_behavior_follow_each_other_and_end_with_it(ros: Ros, tmp_path: Path) -> None:
    walker, stage = ros.walker(steps=20), Served(ros, tmp_path, walks=True)
    with closing(stage.machine):
        until(lambda: walker.end(1) == "succeeded", "the first goal", patience_s=60.0)
        walker.set(steps=100_000)
        until(lambda: 2 in walker.said("began"), "the second goal", patience_s=30.0)
        manual = ["std_msgs/msg/String", {"data": "manual"}, "reliable"]
        stage.robot.set(others={**burger.OTHERS, "mode": manual})
        until(lambda: walker.end(2) == "canceled", "an inhibited goal is canceled")
        stage.robot.set(others=burger.OTHERS)
        until(
            lambda: walker.said("began")[-1] == 2 and len(walker.said("ended")) < len(walker.said("began")),
            "again",
        )
        stop = partial(stage.machine.run, "stop", "--robot", "burger")
        until(lambda: stop().wait() == 0, "the server has agreed in time")
        until(lambda: len(walker.said("ended")) == len(walker.said("began")), "a stop cancels it")
        assert stage.machine.run("stop", "--robot", "burger", "--release").wait() == 0
        until(lambda: len(walker.said("ended")) < len(walker.said("began")), "it goes on")
        stage.leader.interrupt()
        until(lambda: len(walker.said("ended")) == len(walker.said("began")), "the end of the program, too")
        assert contracts_held(stage.leader.out), stage.leader.out


OF_TURTLEBOT = {
    "battery_state": ["sensor_msgs/msg/BatteryState", {"percentage": 75.0}, "reliable"],
    "imu": ["sensor_msgs/msg/Imu", {"orientation": {"w": 1.0}}, "reliable"],
}


def test_a_turtlebot_wanders_for_a_minute_without_a_contact(ros: Ros, tmp_path: Path) -> None:
    robot = ros.foreign(others=OF_TURTLEBOT, twist="TwistStamped", frame="base_scan")
    folder = tmp_path / "robots" / "turtlebot"
    shutil.copytree(ROOT / "robots" / "turtlebot", folder)
    body = folder / "turtlebot.toml"
    body.write_text(body.read_text().replace("[ros2]\n", f'[ros2]\npython = "{ros.python}"\n', 1))
    named, recording = f"turtlebot={folder / 'turtlebot.colony'}", str(tmp_path / "run.mcap")
    with closing(Machine(tmp_path)) as machine:
        supervisor = machine.start("serve", "all", "--robot", named, "--hardware")
        until(
            lambda: failed(supervisor) or "no program runs" in machine.run("ps", "--robot", "turtlebot").out,
            "it is served",
        )
        drive = ("drive", "wander", "--robot", named, "--duration", "60", "--record", recording)
        done = machine.run(*drive, patience_s=180.0)
        assert done.wait() == 0, done.err
        assert contracts_held(done.out), done.out
        assert sum(row["v"] > 0.0 for row in robot.heard) > 200
        assert not any(row["touched"] for row in robot.heard)
        assert machine.run("audit", recording).wait() == 0
