"""A robot that another controller drives: it is served read-only, and a shadow judges that controller."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path

import pytest

from colony.runtime.transport.live.run_directory import RunDirectory
from tests.cli.machine import Machine, failed
from tests.ros2 import burger
from tests.ros2.ros import Ros
from tests.waiting import until

pytestmark = pytest.mark.ros2

BLINK_NS = 100_000_000
"""Longest time between the arrival of one message at two nodes, on a busy machine."""


@pytest.mark.parametrize("twist", ["Twist", "TwistStamped"])
def test_a_shadow_judges_the_controller_that_drives(ros: Ros, tmp_path: Path, twist: str) -> None:
    machine = Machine(tmp_path)
    program = str(burger.write(tmp_path, ros.python))
    named = f"burger={tmp_path / 'robots' / 'burger' / 'burger.colony'}"
    robot = ros.foreign(others=burger.OTHERS, twist=twist, second=twist, command=[0.2, 0.0])
    with closing(machine):
        served = machine.start("serve", "all", "--robot", named, "--hardware", "--read-only")
        running = RunDirectory.find(machine.environment).robot("burger")
        until(lambda: failed(served) or "RServer" in dict(running.running()), "it is served")
        shadow = machine.start("shadow", program, "--robot", named, "--record", "s.jsonl", "--format", "json")
        drives = "the controller commanded drive(velocity = 0.2 m/s, turn = 0 rad/s)"
        until(lambda: failed(served, shadow) or drives in shadow.err, "the controller is heard")
        refused = machine.run("drive", program, "--robot", named)
        assert refused.wait() == 1
        assert "the robot is served with --read-only, as another controller commands it" in refused.err
        assert (
            "read-only: another controller commands the robot" in machine.run("ps", "--robot", "burger").out
        )
        robot.set(near=True)
        until(lambda: failed(served, shadow) or "by avoid" in shadow.err, "the program would avoid")
        robot.set(command=[0.1, 0.5])
        turns = "the controller commanded drive(velocity = 0.1 m/s, turn = 0.5 rad/s)"
        until(lambda: failed(served, shadow) or turns in shadow.err, "it is heard to turn")
        origin_ns = running.origin_ns()
        assert shadow.interrupt() == 130
        report = json.loads(shadow.out)["controller"]
        assert [breach["contract"] for breach in report["breaches"]] == ["clear"]
        (drive, lamp) = report["actuators"]
        assert lamp["frames"] == 0
        assert {row["module"] for row in drive["modules"] if row["frames"]} >= {"ahead", "avoid"}
        rows = [json.loads(line) for line in (shadow.folder / "s.jsonl").read_text().splitlines()]
        heard = [(row["t"], row["@heard"]["drive"]) for row in rows if row["@heard"]["drive"] is not None]
        assert len(heard) == drive["frames"] > 20
        for t_s, command in heard:
            arrived_ns = origin_ns + t_s * 1e9 - command["@age_ns"]
            values = pytest.approx(command["velocity"]), pytest.approx(command["turn"])
            assert any(
                (row["v"], row["w"]) == values and abs(row["t"] - arrived_ns) < BLINK_NS
                for row in robot.heard
            )
        assert {(row["v"], row["w"]) for row in robot.heard} == {(0.2, 0.0), (0.1, 0.5)}
        served.interrupt()
    assert {(row["v"], row["w"]) for row in robot.heard} == {(0.2, 0.0), (0.1, 0.5)}
