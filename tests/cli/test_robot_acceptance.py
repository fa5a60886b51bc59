"""`colony robot test`: what it refuses, and short tests of a real served robot."""

from __future__ import annotations

import json
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cli.conftest import Colony
from tests.cli.machine import Machine, children_of
from tests.waiting import until

LATE = re.compile(
    r"emergency stop: held only after|the base did not brake|not recovered within|not every act"
)
"""Failures of a machine that does something else at that moment; all others are of the robot."""


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Machine]:
    (tmp_path / "t").mkdir()
    made = Machine(tmp_path, TMPDIR=str(tmp_path / "t"))
    try:
        yield made
    finally:
        made.close()


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
    colony: Colony, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], message: str
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    code, out, err = colony("robot", "test", *arguments)
    assert (code, out) == (2, "")
    assert message in err
    assert not list(tmp_path.glob("colony-test-*"))


@pytest.mark.long
def test_a_served_robot_passes(machine: Machine, tmp_path: Path) -> None:
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
    assert {"Clock, Runtime", "RServer", "clients"} <= found["memory"].keys()
    audit = machine.run("audit", str(ran.folder / "run.mcap"), "--format", "json")
    assert json.loads(audit.out)["agrees"]
    assert bool(list((tmp_path / "t").glob("colony-test-*"))) is not found["passes"]


@pytest.mark.long
def test_ctrl_c_ends_the_test_with_what_was_found_so_far(machine: Machine, tmp_path: Path) -> None:
    started = machine.start("robot", "test", "rome", "--duration", "1000")
    until(lambda: started.ended() or len(children_of(started.pid)) > 3, "the robot is served")
    started.tell(signal.SIGINT)
    assert started.wait() == 130, started.err
    assert "so far: interrupted after" in started.out
    assert not list((tmp_path / "t").iterdir())
