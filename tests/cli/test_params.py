"""`colony params`: what a behavior declares, and what a run's Clock has."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.runtime.library import clock as library
from colony.runtime.protocol.deployment import Tunable
from colony.runtime.protocol.interface import Interface
from colony.runtime.protocol.topics import CLOCK
from tests.cli.conftest import Colony
from tests.cli.machine import ROBOT, Machine, failed
from tests.kit.clock import deployed
from tests.waiting import until

BEHAVIOR = """language 1
import robot
tunable param roaming = 0.3 m/s in 0.1 m/s .. 0.6 m/s
module roam { when true do drive(velocity = roaming, turn = 0) }
network { drive = roam }
"""
SPEED = Tunable(name="roaming", unit="m/s", initial=0.3, low=0.1, high=0.6)
GAIN = Tunable(name="turn.gain", unit="", initial=2.0, low=0.0, high=5.0)


def test_the_params_of_a_behavior(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, colony: Colony) -> None:
    monkeypatch.chdir(tmp_path)
    Path("b.colony").write_text(BEHAVIOR)
    listed = "  roaming  0.3 m/s  in 0.1 .. 0.6 m/s\n"
    assert colony.output("params", "list", "b.colony", "--robot", "rome") == listed
    Path("b.colony").write_text(BEHAVIOR.replace("tunable ", "").replace(" in 0.1 m/s .. 0.6 m/s", ""))
    assert colony("params", "list", "b.colony", "--robot", "rome").err == "no tunable params\n"


def test_those_of_a_run_are_listed_set_saved_and_reset(
    machine: Machine, colony: Colony, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    served = machine.start("serve", CLOCK, "--robot", ROBOT)
    until(lambda: failed(served) or CLOCK in machine.directory.running(), "the Clock runs")
    assert colony("params", "list") == (0, "", "no tunable params\n")
    with machine.session() as session, session.connect(CLOCK) as clock:
        clock.do(library.deploy(deployed(actuators=(), interface=Interface(), tunables=(SPEED, GAIN))))
        done = colony("params", "set", "roaming=250 mm/s", "turn.gain=-0")
        assert (done.code, done.err) == (0, "")
        assert done.out.startswith("in force from frame ")
        listed = "* roaming    0.25 m/s  in 0.1 .. 0.6 m/s\n* turn.gain  -0        in 0 .. 5\n"
        assert colony("params", "list") == (0, listed, "")
        assert colony("params", "get", "roaming", "--robot", ROBOT) == (0, "0.25 m/s\n", "")
        assert colony("params", "save", "site.toml") == (0, "wrote roaming, turn.gain into site.toml\n", "")
        assert Path("site.toml").read_text() == 'roaming = "0.25 m/s"\nturn.gain = "-0"\n'
        for code, arguments, said in (
            (1, ("set", "roaming=2"), "`roaming` cannot be 2: expected 0.1 .. 0.6 m/s"),
            (2, ("set", "roaming=1 kg"), "`roaming`: found `1 kg`; expected a number in m/s"),
            (2, ("set", "roming=1"), "the program has no tunable param `roming`; did you mean `roaming`?"),
            (2, ("get", "speed"), "the program has no tunable param `speed`"),
        ):
            refused = colony("params", *arguments)
            assert (refused.code, refused.out, refused.err.count("\n")) == (code, "", 1), arguments
            assert said in refused.err
        assert colony("params", "reset", "turn.gain").code == 0
        assert colony.output("params", "get", "turn.gain") == "2\n"
        assert colony("params", "reset").code == 0
        saved = colony("params", "save", "site.toml")
        assert (saved.code, saved.err) == (0, "nothing was changed; site.toml stays as it is\n")
    assert served.interrupt() == 0


def test_misuse_is_one_line(machine: Machine, colony: Colony) -> None:
    for arguments, said in (
        (("list",), "no robot with a Clock runs on this machine"),
        (("set",), "Missing argument"),
        (("get", "X", "--robot", ROBOT), ROBOT),
    ):
        done = colony("params", *arguments)
        assert (done.code, done.out, done.err.count("\n")) == (2, "", 1), arguments
        assert said in done.err
