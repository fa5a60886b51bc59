"""`colony robot test`: what it refuses, and short tests of a real served robot."""

from __future__ import annotations

import json
import re
import signal
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from colony.drivers.create2.firmware import Create2Firmware, EmulatedWorld
from colony.drivers.emulator import Emulator, room
from tests.cli.conftest import Colony
from tests.cli.machine import Machine, children_of
from tests.waiting import until

LATE = re.compile(
    r"emergency stop: held only after|the base did not brake|not recovered within|not every act"
)
"""Failures of a machine that does something else at that moment; all others are of the robot."""


@pytest.fixture
def temporary() -> Iterator[Path]:
    """A folder for temporary files whose name is short enough for sockets."""
    with TemporaryDirectory(prefix="t-", dir="/tmp") as folder:
        yield Path(folder)


@pytest.fixture
def machine(tmp_path: Path, temporary: Path) -> Iterator[Machine]:
    with closing(Machine(tmp_path, TMPDIR=str(temporary))) as made:
        yield made


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nobody",), "there is no description `nobody`"),
        (("a/b",), "`a/b` cannot be the name of a robot"),
        (("amr", "--duration", "never"), "--duration: found `never`"),
        (("amr", "--hardware"), "the body of `amr` names no driver"),
        (("amr", "-o", "run.jsonl"), "expected *.mcap"),
        (("amr", "--behavior", "nothing.colony"), "nothing.colony"),
        (("amr", "--map", "nowhere"), "nowhere"),
    ],
)
def test_misuse_is_refused_before_anything_is_started(
    colony: Colony, temporary: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], message: str
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    assert message in colony.refusal("robot", "test", *arguments)
    assert not list(temporary.iterdir())


@pytest.mark.long
def test_a_served_robot_passes(machine: Machine, temporary: Path) -> None:
    ran = machine.run(
        "robot", "test", "rome", "--duration", "5", "--format", "json", "-o", "run.mcap", "--seed", "4"
    )
    found = json.loads(ran.out)
    assert [reason for reason in found["failures"] if not LATE.search(reason["text"])] == []
    assert ran.process.returncode == (0 if found["passes"] else 1)
    assert found["stops"]
    assert all(stop["slip"] is None and "Clock" in stop["acknowledged"] for stop in found["stops"])
    assert {fault["kind"] for fault in found["faults"]} == {"kill", "freeze"}
    assert found["audit"]["compared"] > 0
    servers, leader, *_ = sorted(found["memory"])
    assert servers.startswith("Clock, ")
    assert "Leader" in leader.split(", ")
    audit = machine.run("audit", str(ran.folder / "run.mcap"), "--format", "json")
    assert json.loads(audit.out)["agrees"]
    assert bool(list(temporary.glob("colony-test-*"))) is not found["passes"]


@pytest.mark.long
def test_real_devices_are_tested_through_their_drivers(machine: Machine) -> None:
    robot = Create2Firmware(EmulatedWorld(range=room(3000.0, 2000.0)))
    with closing(Emulator(robot, baud=115_200)) as emulator:
        emulator.start()
        arguments = ("r1=create2", "--port", emulator.port, "--behavior", "bounce", "--duration", "5")
        ran = machine.run("robot", "test", *arguments, "--format", "json")
        found = json.loads(ran.out)
    assert "r1: the robot will drive" in ran.err
    assert [reason for reason in found["failures"] if not LATE.search(reason["text"])] == []
    assert any("RServer" in name.split(", ") for name in found["memory"])
    assert found["driven_mm"] is None


@pytest.mark.long
def test_ctrl_c_ends_the_test_with_what_was_found_so_far(machine: Machine, temporary: Path) -> None:
    started = machine.start("robot", "test", "rome", "--duration", "1000")
    until(lambda: started.ended() or len(children_of(started.pid)) > 2, "the robot is served")
    started.tell(signal.SIGINT)
    assert started.wait() == 130, started.err
    assert "so far: interrupted after" in started.out
    assert not list(temporary.iterdir())
