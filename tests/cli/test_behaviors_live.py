"""The behaviors that come with the project, as processes: what is on time is as the interpreter decides."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Colony
from tests.cli.machine import MAP, ROBOT, Machine, failed, status
from tests.paths import ROBOTS, ROOT
from tests.sampling import sampled
from tests.waiting import until

DRIVING = [f for f in sorted((ROOT / "behaviors").glob("*.colony")) if "\nnetwork {" in f.read_text()]
SETTINGS = {"teleop": ("--set", "TeleopVelocity=200")}
SEED = 1
ON_OTHERS = dict.fromkeys(("amr", "omni", "pioneer", "turtlebot"), "wander") | {"create2": "bounce"}
"""What the other robots drive, by their names."""
FAR_ENOUGH_MM = 200.0


def test_most_of_them_drive() -> None:
    assert len(DRIVING) >= 6


@pytest.mark.long
@pytest.mark.parametrize("file", sampled(DRIVING, every=3, thorough=True), ids=lambda path: path.stem)
def test_it_decides_as_the_interpreter_does(file: Path, machine: Machine, colony: Colony) -> None:
    asked = ("--map", MAP, "--processes", "--duration", "2", "--seed", str(SEED), "--no-picture")
    told = ("--record", "run.mcap", "--format", "json", *SETTINGS.get(file.stem, ()))
    run = machine.start("run", str(file), *asked, *told)
    assert run.wait() == 0, run.err
    assert json.loads(run.out)["disagreements"] == []
    audited = colony("audit", run.folder / "run.mcap", "--format", "json")
    assert audited.code == 0, audited.out + audited.err
    report = json.loads(audited.out)
    assert report["agrees"] is True
    assert report["compared"] >= 20  # decisions, of 40 frames or more; fewer where the machine is busy


def test_all_other_robots_drive_something() -> None:
    assert {ROBOT, *ON_OTHERS} == {path.stem for path in ROBOTS}


@pytest.mark.long
@pytest.mark.parametrize(("robot", "behavior"), ON_OTHERS.items())
def test_a_robot_of_another_kind_drives_and_decides_as_the_interpreter_does(
    robot: str, behavior: str, machine: Machine, colony: Colony
) -> None:
    where = ("--robot", f"{ROBOT}={robot}", "--map", MAP, "--processes", "--duration", "1000")
    run = machine.start("run", behavior, *where, "--seed", str(SEED), "--no-picture", "--record", "run.mcap")

    def is_far_enough() -> bool:
        truth = machine.truth()
        return truth is not None and truth.distance > FAR_ENOUGH_MM

    until(lambda: failed(run) or is_far_enough(), "the robot has driven")
    # On a busy machine the robot drives before the leader hears of frames.
    with machine.session() as session:
        until(lambda: (found := status(session)) is not None and found.frames > 0, "frames are recorded")
    assert run.interrupt() == 130, run.err
    audited = colony("audit", run.folder / "run.mcap", "--format", "json")
    assert audited.code == 0, audited.out + audited.err
    assert json.loads(audited.out)["agrees"] is True
