"""`colony run --processes`: a robot of real processes, and what may happen to them."""

from __future__ import annotations

import json
import os
import re
import signal
from pathlib import Path

import pytest

from colony.runtime.library.leader import ClientStanding, RunStatus
from tests.cli.conftest import Colony
from tests.cli.machine import (
    MAP,
    ROBOT,
    WANDER,
    Machine,
    Started,
    children_of,
    contracts_held,
    failed,
    lives,
    status,
)
from tests.waiting import until

SERVERS = ("Clock", "RServer", "PServer", "DServer", "Simulator")
CLIENTS = ("drive/back_off", "drive/avoid", "drive/keep_middle", "drive/cruise", "drive/.bounds")


def start(machine: Machine, *options: str, duration: str = "1000") -> Started:
    arguments = ("--map", MAP, "--processes", "--duration", duration, "--seed", "1", *options)
    return machine.start("run", WANDER, *arguments)


def driving(machine: Machine, run: Started) -> set[int]:
    """Wait until the robot drives; gives the processes of the run."""
    until(lambda: failed(run) or machine.moves(), "the robot drives")
    return children_of(run.pid)


def audit(colony: Colony, recording: Path) -> None:
    """The reference interpreter says the same of every frame."""
    result = colony("audit", recording)
    assert result.code == 0, result.out + result.err


@pytest.mark.long
@pytest.mark.parametrize(("options", "names"), [((), {"Simulator"}), (("--isolate",), {*SERVERS, "clients"})])
def test_a_run_decides_as_the_interpreter_does_and_leaves_nothing_behind(
    machine: Machine, colony: Colony, options: tuple[str, ...], names: set[str]
) -> None:
    run = start(machine, "--record", "run.mcap", "--format", "json", *options, duration="3")
    processes = driving(machine, run)
    assert len(processes) == len(names)
    assert run.wait() == 0, run.err
    assert not any(map(lives, processes))
    assert machine.directory.running() == {}
    summary = json.loads(run.out)
    assert summary["robot"] == ROBOT
    assert summary["disagreements"] == []
    assert summary["distance_mm"] > 100.0
    assert summary["frames"] >= 50  # of 60; more may be left out while the machine is busy
    assert (run.folder / "run.png").read_bytes().startswith(b"\x89PNG")
    audit(colony, run.folder / "run.mcap")


def test_ps_shows_the_processes_and_ctrl_c_keeps_the_recording(machine: Machine, colony: Colony) -> None:
    run = start(machine, "--record", "run.mcap")
    processes = driving(machine, run)
    with machine.session() as session:
        until(lambda: (found := status(session)) is not None and found.frames > 10, "it has heard of frames")
    (state,) = json.loads(colony("ps", "--format", "json").out)
    shown = state["run"]["processes"]
    assert {*shown.values()} == {*children_of(run.pid)}
    printed = colony("ps", "--robot", ROBOT).out
    assert "process  id" not in printed
    assert f"  Simulator  up, process {shown['Simulator']}\n" in printed
    for server in ("Clock", "RServer", "PServer", "DServer", "Leader"):
        assert re.search(rf"  {server} +up, process {run.pid}\n", printed), printed
    assert run.interrupt() == 130
    assert "interrupted" in run.out
    assert contracts_held(run.out), run.out
    assert not any(map(lives, processes))
    assert machine.directory.running() == {}
    assert (run.folder / "run.png").read_bytes().startswith(b"\x89PNG")
    audit(colony, run.folder / "run.mcap")


@pytest.mark.long
def test_who_dies_or_is_frozen_comes_back(machine: Machine, colony: Colony) -> None:
    run = start(machine, "--record", "run.mcap", "--no-picture", "--format", "json", "--isolate")
    driving(machine, run)
    with machine.session() as session:

        def standing() -> RunStatus:
            return until(lambda: status(session), "the leader answers")

        def clients() -> tuple[ClientStanding, ...]:
            return standing().clients

        def goes_on() -> None:
            """All of them are there again, and the robot drives."""
            since = standing().frames

            def well() -> bool:
                found = standing()
                return found.frames > since and all(c.standing == "alive" for c in found.clients)

            until(well, "all clients are there")
            until(machine.moves, "the robot drives")

        goes_on()
        pids = {name: machine.pid(name) for name in SERVERS}
        for name, pid in pids.items():
            assert pid is not None
            os.kill(pid, signal.SIGKILL)
            until(lambda name=name, pid=pid: machine.pid(name) not in (None, pid), f"{name} is started again")
            goes_on()
        until(lambda: all(c.on_time > 0 for c in clients()), "they are on time")
        os.kill(standing().processes["clients"], signal.SIGKILL)
        until(lambda: all(c.restarts == 1 for c in clients()), "they are started again")
        assert {c.last_error for c in clients()} == {"was killed by SIGKILL"}
        shown = colony("ps", "--robot", ROBOT).out
        assert shown.count("was killed by SIGKILL") == len(CLIENTS), shown
        goes_on()
        victim = standing().processes["clients"]
        os.kill(victim, signal.SIGSTOP)
        until(lambda: all(c.standing == "lost" for c in clients()), "they are lost")
        until(machine.stands, "the robot stands")
        os.kill(victim, signal.SIGCONT)
        goes_on()
        base = machine.pid("RServer")
        assert base is not None
        os.kill(base, signal.SIGSTOP)
        until(machine.stands, "the base stops by itself")
        os.kill(base, signal.SIGCONT)
        goes_on()
        run.tell(signal.SIGINT)
    assert run.wait() == 130
    assert json.loads(run.out)["disagreements"] == []
    for name in (*SERVERS, "clients"):
        assert f"{name} was killed by SIGKILL; it is restarted" in run.err
    audit(colony, run.folder / "run.mcap")


def test_a_leader_that_is_killed_leaves_nothing_behind(machine: Machine) -> None:
    run = start(machine, "--no-picture")
    processes = driving(machine, run)
    run.tell(signal.SIGKILL)
    run.process.wait()
    until(lambda: not any(map(lives, processes)), "all processes end")
    assert machine.directory.running() == {}


@pytest.mark.long
def test_a_robot_has_one_run_at_a_time(machine: Machine) -> None:
    run = start(machine, "--no-picture")
    driving(machine, run)
    second = start(machine, "--no-picture")
    assert second.wait() == 2
    assert f"Leader of {ROBOT} is already running" in second.err
    assert len(second.err.splitlines()) == 1
    run.tell(signal.SIGTERM)
    assert run.wait() == 130


BROKEN = """
import sys
if "child" in sys.argv[0]:
    raise OSError("no camera here")
class Seeks:
    def step(self, readings):
        return None
"""


@pytest.mark.long
def test_a_module_in_python_that_cannot_live_ends_the_run(machine: Machine, tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text(BROKEN)
    (tmp_path / "b.colony").write_text(
        """
robot rome {
  sensor bumper : bool from RServer.bumper
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s }
           to RServer.drive idle drive(velocity = 0, turn = 0)
}
module seeks from python "broken:Seeks" { reads bumper  commands drive }
network { drive = seeks }
"""
    )
    run = machine.start("run", str(tmp_path / "b.colony"), "--map", MAP, "--processes", "--no-picture")
    assert run.wait() == 1
    assert "no camera here" in run.err


BAD_OPTIONS: list[tuple[tuple[str, ...], str]] = [
    ((), "no robot: give --map MAP to simulate one, or `colony drive`"),
    (("--map", MAP, "--connect"), "--connect is an option of `colony drive`"),
    (("--shadow",), "--shadow is an option of `colony shadow`"),
    (("--conect",), "No such option '--conect'"),
    (("--map", MAP, "--fsync"), "--fsync requires --processes"),
    (("--map", MAP, "--camera", "90"), "--camera requires --processes"),
    (("--map", MAP, "--processes", "--camera", "left=down"), "found `left=down`"),
    (("--map", MAP, "--processes", "--robot", "a/b"), "`a/b` cannot be the name of a robot"),
    (("--map", MAP, "--robot", "a/b"), "`a/b` cannot be the name of a robot"),
    (("--map", MAP, "--processes", "--physics", "mujoco"), "--physics mujoco excludes --processes"),
    (
        ("--map", MAP, "--physics", "mujoco", "--from", "201", "--to", "216"),
        "--physics mujoco excludes --to",
    ),
    (("--map", MAP, "--physics", "bullet"), "'bullet' is not one of 'kinematic', 'mujoco'"),
]
DRIVE_OPTIONS: list[tuple[tuple[str, ...], str]] = [
    (("--connect", "tls/x:7447"), "requires --security"),
    (("--connect", "tcp/x:7447", "--security", "f"), "is unencrypted"),
    (("--security", "f"), "--security requires --connect"),
    (("--realtime",), "No such option '--realtime'"),
    (
        ("--robot", "nobody"),
        "no process of `nobody` runs on this machine (running robots: none); "
        "start it with `colony serve all --robot nobody=rome --map MAP`",
    ),
]


@pytest.mark.parametrize(
    ("command", "options", "expected"),
    [*(("run", *row) for row in BAD_OPTIONS), *(("drive", *row) for row in DRIVE_OPTIONS)],
)
def test_options_that_make_no_sense(
    colony: Colony,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    options: tuple[str, ...],
    expected: str,
) -> None:
    monkeypatch.setenv("COLONY_RUN_DIR", str(tmp_path / "r"))
    assert expected in colony.one_line(command, WANDER, *options)
