"""`colony serve`, `ps`, `stop` and `drive`: a robot that is there, for programs that come and go."""

from __future__ import annotations

import json
import os
import re
import signal
from contextlib import suppress
from pathlib import Path

import pytest

from colony.runtime.kit.connection import Connection
from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.library import data, robot
from tests.cli.conftest import Colony
from tests.cli.machine import MAP, ROBOT, WANDER, Machine, Started, children_of, failed, lives, status
from tests.waiting import until

SERVERS = {"Clock", "RServer", "PServer", "DServer", "Runtime"}


@pytest.fixture
def served(machine: Machine) -> Started:
    """All servers of a simulated robot."""
    started = machine.start("serve", "all", "--robot", ROBOT, "--map", MAP, "--seed", "1")
    until(lambda: failed(started) or set(machine.directory.running()) >= SERVERS, "all servers run")
    return started


def test_programs_come_and_go_and_anyone_can_stop_the_robot(
    machine: Machine, served: Started, colony: Colony
) -> None:
    expected = dict.fromkeys([*SERVERS, "Simulator", "Supervisor"], "up")
    until(lambda: {s["server"]: s["state"] for s in _ps(colony)["servers"]} == expected, "all answer")
    until(lambda: "no program runs, but the limits of rome hold" in colony("ps").out, "its limits hold")
    run = machine.start("drive", WANDER, "--set", "DockedAt=0")
    until(machine.moves, "the robot drives")
    with machine.session() as session:
        with session.connect("RServer", name="joystick", priority=7):
            state = _ps(colony)
            assert ("joystick", 7) in [
                (c["name"], c["priority"]) for s in state["servers"] for c in s["connections"]
            ]
        out = colony.output("ps", "--robot", ROBOT)
        assert "drive/keep_middle" in out
        assert f"led by process {run.pid}" in out
        assert state["run"]["frames"] > 0
        assert [c["address"] for c in state["run"]["clients"]] == [
            "drive/back_off",
            "drive/avoid",
            "drive/keep_middle",
            "drive/cruise",
            "drive/.bounds",
        ]
        stopped = colony("stop")
        assert (stopped.code, stopped.out.partition(" by ")[0]) == (0, f"{ROBOT}: stopped")
        until(machine.stands, "the robot stands")
        assert "EMERGENCY STOP" in colony("ps").out
        before = until(lambda: status(session), "the leader answers").frames
        until(lambda: (s := status(session)) and s.frames > before + 10, "the run goes on")
        assert machine.stands()
        assert colony("stop", "--release").out.startswith(f"{ROBOT}: released")
        until(machine.moves, "the robot drives again")
        with session.connect("DServer", name="test") as variables:
            assert variables.do(data.get("DockedAt")) == 0
    assert run.interrupt() == 130
    until(machine.stands, "the robot stands")
    assert served.interrupt() == 0
    assert colony("ps").code == 1


def _ps(colony: Colony) -> dict[str, object]:
    (found,) = json.loads(colony.output("ps", "--format", "json"))
    return found  # type: ignore[no-any-return]


@pytest.mark.long
def test_a_killed_leader_leaves_the_robot_standing_and_a_run_outlives_a_killed_robot(
    machine: Machine, served: Started
) -> None:
    run = machine.start("drive", WANDER)
    until(machine.moves, "the robot drives")
    clients = children_of(run.pid)
    run.tell(signal.SIGKILL)
    run.process.wait()
    until(machine.stands, "the robot stands")
    until(lambda: not any(map(lives, clients)), "the clients end")
    again = machine.start("drive", WANDER, "--duration", "6")
    _has_begun(machine, again)
    servers = children_of(served.pid)
    served.tell(signal.SIGKILL)  # its servers end with it
    served.process.wait()
    until(lambda: not any(map(lives, servers)), "the servers end")
    assert again.wait() == 0, again.err
    assert f"{ROBOT} does not answer: its Clock does not run; waiting up to 30 s for it" in again.err
    assert re.search(rf"{ROBOT} did not answer in the last \d+\.\d s of the run", again.err), again.err


def _has_begun(machine: Machine, run: Started) -> None:
    """Wait until the leader of the run has seen frames."""
    with machine.session() as session:
        until(lambda: failed(run) or ((s := status(session)) and s.frames > 0), "frames are decided")


@pytest.mark.long
def test_a_run_ends_when_the_whole_robot_stays_away(
    machine: Machine, served: Started, tmp_path: Path
) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        "from colony.runtime.assembly.processes import window\nwindow.GIVE_UP_AFTER_S = 2.0\n"
    )
    machine.environment["PYTHONPATH"] += f":{tmp_path}"
    run = machine.start("drive", WANDER)
    _has_begun(machine, run)
    for pid in (served.pid, *children_of(served.pid)):
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    served.process.wait()
    assert run.wait() == 1
    assert f"colony: error: {ROBOT} has not answered for 2 s: its Clock does not run" in run.err


@pytest.mark.long
def test_a_stop_is_pressed_until_those_that_were_frozen_have_it(machine: Machine, served: Started) -> None:
    frozen = children_of(served.pid)
    for pid in frozen:
        os.kill(pid, signal.SIGSTOP)
    try:
        stop = machine.start("stop", "--robot", ROBOT)
        until(lambda: "pressing on for 10 s" in stop.err or stop.ended(), "the stop is pressed on")
    finally:
        for pid in frozen:
            os.kill(pid, signal.SIGCONT)
    assert stop.wait() == 0, stop.err
    assert "acknowledged by Clock, RServer, DServer" in stop.out


@pytest.mark.long
def test_a_stop_waits_for_the_successors_of_those_that_have_just_died(
    machine: Machine, served: Started
) -> None:
    for pid in children_of(served.pid):
        os.kill(pid, signal.SIGKILL)
    stop = machine.start("stop", "--robot", ROBOT)
    assert stop.wait() == 0, stop.err
    assert "Clock" in stop.out


@pytest.mark.long
def test_a_run_goes_on_when_the_robot_comes_back(machine: Machine, served: Started) -> None:
    run = machine.start("drive", WANDER)
    _has_begun(machine, run)
    servers = children_of(served.pid)
    served.tell(signal.SIGKILL)
    served.process.wait()
    until(lambda: not any(map(lives, servers)), "the servers end")
    until(lambda: "does not answer" in run.err, "the run reports it")
    again = machine.start("serve", "all", "--robot", ROBOT, "--map", MAP, "--seed", "1")
    until(lambda: "answers again, after" in run.err or run.ended(), "the run notices that it is back")
    until(lambda: failed(run) or machine.moves(), "the robot drives again")
    for one, code in ((run, 130), (again, 0)):
        assert one.interrupt() == code


def reports(base: Connection) -> bool:
    """Whether the base behind RServer reports its state."""
    try:
        base.do(robot.position())
    except CallRefusedError:
        return False
    return True


@pytest.mark.long
def test_one_server_at_a_time(machine: Machine, colony: Colony) -> None:
    simulator = machine.start("serve", "Simulator", "--robot", ROBOT, "--map", MAP, "--camera", "left=90")
    until(lambda: machine.pid("Simulator"), "the simulator runs")
    servers = ["Clock", "RServer", "PServer", "DServer"]
    limits = machine.start("serve", "Limits", "--robot", ROBOT)
    started = {name: machine.start("serve", name, "--robot", ROBOT) for name in servers}
    started["CServer_left"] = machine.start("serve", "CServer", "--robot", ROBOT, "--camera", "left=90")
    for name, one in started.items():
        until(lambda one=one: one.ended() or "listens at" in one.err, f"{name} listens")
        assert f"{name} of {ROBOT} listens at {machine.directory.socket(name)}" in one.err
    assert f"RServer of {ROBOT} is already running" in colony.refusal("serve", "RServer", "--robot", ROBOT)
    with machine.session() as session, session.connect("RServer", name="test", priority=3) as base:
        until(lambda: reports(base), "RServer has found the plant")
        base.do(robot.go(200.0, lease=60.0))
        until(machine.moves, "the robot drives")
        started["RServer"].tell(signal.SIGTERM)
        assert started["RServer"].wait() == 0
        until(machine.stands, "the base was stopped")
    for one in (*started.values(), limits, simulator):
        if not one.ended():
            assert one.interrupt() == 0


def test_stop_passes_over_a_shared_data_server_and_trouble_with_another_robot(
    machine: Machine, colony: Colony
) -> None:
    fleet = machine.serve("DServer", "--robot", "fleet")
    assert "no robot runs on this machine that has a base; found fleet" in colony.refusal("stop")
    base = machine.serve("RServer", "--robot", ROBOT)
    unkept = colony("stop")
    assert (unkept.code, unkept.out) == (1, f"{ROBOT}: stopped; acknowledged by RServer\n")
    assert "the Clock is down" in unkept.err
    clock = machine.serve("Clock", "--robot", ROBOT)
    both = colony("stop")
    assert (both.code, both.err) == (0, "")
    assert both.out.startswith(f"{ROBOT}: stopped by ")
    assert both.out.endswith("; acknowledged by Clock, RServer\n")
    assert colony("stop", "--robot", "fleet").code == 1
    other = machine.serve("Clock", "--robot", "arezzo")
    folder = machine.directory.path.parent / "arezzo"
    folder.chmod(0o755)
    try:
        trouble = colony("stop")
    finally:
        folder.chmod(0o700)
    assert trouble.code == 1
    assert trouble.out.startswith(f"{ROBOT}: stopped by ")
    assert "arezzo is open to others" in trouble.err
    for one in (fleet, base, clock, other):
        assert one.interrupt() == 0


SERVE_ALL = ("serve", "all", "--robot", "r", "--map", MAP)
USERS = ("--connect", "tls/x:1", "--security", "f")

BAD_OPTIONS: list[tuple[tuple[str, ...], str]] = [
    (("serve", "all", "--robot", "r"), "all requires --map MAP"),
    (("serve", "Limits", "--robot", "r"), "Limits requires a description with limits"),
    (("serve", "Gateway", "--robot", "r"), "Gateway requires --listen"),
    (("serve", "CServer", "--robot", "r"), "CServer requires one --camera"),
    (
        ("serve", "RServer", "--robot", "r", "--listen", "tls/x:1"),
        "--listen and --security require each other",
    ),
    (("serve", "XServer", "--robot", "r"), "`rome` has no server `XServer`; did you mean `RServer`?"),
    (("serve", "PServer", "--robot", "amr"), "`amr` has no server `PServer`; did you mean `RServer`?"),
    (
        ("serve", "Sonar", "--robot", "amr"),
        "expected Clock, DServer, CServer, Simulator, Limits, Gateway, all, RServer",
    ),
    (("serve", "all", "--robot", "r", "--hardware"), "the body of `rome` names no driver"),
    ((*SERVE_ALL, "--hardware"), "the body of `rome` names no driver"),
    (
        ("serve", "Simulator", "--robot", "r", "--map", MAP, "--hardware"),
        "--hardware is for real devices: with a map it requires `all`",
    ),
    (("serve", "Clock", "--robot", "r", "--hardware", "--camera", "up"), "leave out --camera, --hazards,"),
    (("serve", "all", "--robot", "r", "--read-only"), "--read-only requires --hardware"),
    ((*SERVE_ALL, "--hardware", "--read-only"), "--read-only requires --hardware, without --map"),
    (
        ("serve", "all", "--robot", "create2", "--hardware", "--read-only"),
        "--read-only is for robots on topics of ROS 2: ",
    ),
    (("serve", "RServer", "--robot", "a/b"), "`a/b` cannot be the name of a robot"),
    (("serve", "all", "--robot", "r", "--map", "nowhere"), "nowhere:1:1: error[M001]: cannot read the map"),
    (("ps", "--robot", "a/b"), "`a/b` cannot be the name of a robot"),
    (("stop", "--robot", "a/b"), "`a/b` cannot be the name of a robot"),
    (("stop", "--robot", "a/b", *USERS), "`a/b` cannot be the name of a robot"),
    (("data", "list", "--robot", "a/b"), "`a/b` cannot be the name of a robot"),
    (("serve", "Clock", "--robot", "r", "--state", ""), "found an empty name; expected the name of a folder"),
    ((*SERVE_ALL, "--listen", "tls/localhost:0", "--security", "/dev/zero"), "it is not a regular file"),
    ((*SERVE_ALL, "--listen", "tcp/localhost:0", "--security", "f"), "is unencrypted"),
    (("drive", WANDER, "--robot", ""), "`` cannot be the name of a robot"),
    (("stop",), "no robot runs on this machine"),
    (("stop", "--robot", "r"), "no process of `r` runs on this machine (running robots: none)"),
    (("ps", "--connect", "tls/x:1"), "requires --robot NAME"),
    (("ps", "--robot", "r", "--connect", "tls/x:1"), "requires --security"),
]


@pytest.mark.parametrize(("arguments", "expected"), BAD_OPTIONS, ids=[" ".join(a) for a, _ in BAD_OPTIONS])
def test_options_that_make_no_sense(
    machine: Machine, colony: Colony, arguments: tuple[str, ...], expected: str
) -> None:
    assert expected in colony.one_line(*arguments)


def test_no_robot_is_no_error_but_told_by_the_exit_code(machine: Machine, colony: Colony) -> None:
    assert colony("ps")[:2] == (1, "no robot runs on this machine\n")
    assert colony("ps", "--robot", "r", "--format", "json")[:2] == (1, "[]\n")
