"""A joystick beside a program of real processes obeys its limits, unless it says that it does not."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import pytest

from colony.runtime.kit.connection import Connection
from colony.runtime.library import robot
from tests.cli.conftest import Colony
from tests.cli.machine import MAP, ROBOT, WANDER, Machine, failed
from tests.waiting import until


def drive(base: Connection, count: int) -> None:
    """Full speed ahead, and to the left where there is a wall."""
    for _ in range(count):
        base.do(robot.drive(600.0, 20.0))
        time.sleep(0.1)


@pytest.mark.long
def test_what_a_joystick_sends_is_within_the_limits_of_each_frame(
    machine: Machine, colony: Colony, tmp_path: Path
) -> None:
    recording = tmp_path / "run.jsonl"
    arguments = ("--map", MAP, "--processes", "--duration", "8", "--no-picture", "--record", str(recording))
    run = machine.start("run", WANDER, *arguments)
    until(lambda: failed(run) or machine.moves(), "the robot drives")
    with machine.session() as session, session.connect("RServer", name="joystick", priority=50) as base:
        drive(base, 10)
        base.do(robot.ignore_limits())
        shown = colony("ps", "--robot", ROBOT).out
        assert re.search(r"joystick \(\S+\) ignores the limits of the program", shown), shown
        drive(base, 5)
    assert run.wait() in (0, 1), run.err
    frames = [json.loads(line) for line in recording.read_text().splitlines()]
    outside = [frame["drive"] for frame in frames if "@outside" in frame.get("drive", ())]
    assert any("@unlimited" in sent for sent in outside)
    assert any("@unlimited" not in sent for sent in outside)
    report = json.loads(colony("audit", recording, WANDER, "--format", "json").out)
    assert report["agrees"], report
    assert report["outside"] == len(outside)
