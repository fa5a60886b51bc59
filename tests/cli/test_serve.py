"""`colony serve`, `ps`, `stop` and `run --connect`: a robot that is there, for programs that come and go."""

from __future__ import annotations

import json
import signal

import pytest

from colony.runtime.kit.connection import Session
from colony.runtime.library import data, robot
from tests.cli.conftest import Colony
from tests.cli.machine import MAP, ROBOT, WANDER, Machine, Started, children_of, lives, status
from tests.waiting import until

SERVERS = {"Clock", "RServer", "PServer", "DServer", "Runtime"}


@pytest.fixture
def served(machine: Machine) -> Started:
    """All servers of a simulated robot."""
    started = machine.start("serve", "all", "--robot", ROBOT, "--map", MAP, "--seed", "1")
    until(lambda: started.ended() or set(machine.directory.running()) >= SERVERS, "all servers run")
    assert not started.ended(), started.err
    return started


def test_programs_come_and_go_and_anyone_can_stop_the_robot(
    machine: Machine, served: Started, colony: Colony
) -> None:
    nothing = {s["server"]: s["state"] for s in _ps(colony)["servers"]}
    assert nothing == dict.fromkeys([*SERVERS, "Simulator", "Supervisor"], "up")
    run = machine.start("run", WANDER, "--connect", "--set", "DockedAt=0")
    until(machine.moves, "the robot drives")
    with machine.session() as session:
        with session.connect("RServer", name="joystick", priority=7):
            state = _ps(colony)
            assert ("joystick", 7) in [
                (c["name"], c["priority"]) for s in state["servers"] for c in s["connections"]
            ]
        shown = colony("ps", "--robot", ROBOT)
        assert shown.code == 0
        assert "drive/keep_middle" in shown.out
        assert f"led by process {run.pid}" in shown.out
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
    run.tell(signal.SIGINT)
    assert run.wait() == 130
    until(machine.stands, "the robot stands")
    served.tell(signal.SIGINT)
    assert served.wait() == 0
    assert colony("ps").code == 1


def _ps(colony: Colony) -> dict[str, object]:
    result = colony("ps", "--format", "json")
    assert result.code == 0
    (found,) = json.loads(result.out)
    return found  # type: ignore[no-any-return]


def test_a_leader_that_is_killed_leaves_the_robot_standing(machine: Machine, served: Started) -> None:
    run = machine.start("run", WANDER, "--connect")
    until(machine.moves, "the robot drives")
    clients = children_of(run.pid)
    run.tell(signal.SIGKILL)
    run.process.wait()
    until(machine.stands, "the robot stands")
    until(lambda: not any(map(lives, clients)), "the clients end")
    again = machine.start("run", WANDER, "--connect", "--duration", "1")
    assert again.wait() == 0, again.err
    servers = children_of(served.pid)
    served.tell(signal.SIGKILL)
    served.process.wait()
    until(lambda: not any(map(lives, servers)), "the servers end")


@pytest.mark.long
def test_one_server_at_a_time(machine: Machine, colony: Colony) -> None:
    simulator = machine.start("serve", "Simulator", "--robot", ROBOT, "--map", MAP, "--camera", "left=90")
    until(lambda: machine.pid("Simulator"), "the simulator runs")
    servers = ["Clock", "RServer", "PServer", "DServer"]
    started = {name: machine.start("serve", name, "--robot", ROBOT) for name in servers}
    started["CServer_left"] = machine.start("serve", "CServer", "--robot", ROBOT, "--camera", "left=90")
    for name, one in started.items():
        until(lambda one=one: one.ended() or "listens at" in one.err, f"{name} listens")
        assert f"{name} of {ROBOT} listens at {machine.directory.socket(name)}" in one.err
    second = colony("serve", "RServer", "--robot", ROBOT)
    assert second.code == 2
    assert f"RServer of {ROBOT} is already running" in second.err
    with machine.session() as session, session.connect("RServer", name="test", priority=3) as base:
        until(machine.truth, "the plant answers")
        base.do(robot.go(200.0, lease=60.0))
        until(machine.moves, "the robot drives")
        started["RServer"].tell(signal.SIGTERM)
        assert started["RServer"].wait() == 0
        until(machine.stands, "the base was stopped")
    for one in (*started.values(), simulator):
        if not one.ended():
            one.tell(signal.SIGINT)
            assert one.wait() == 0


def test_stop_passes_over_a_data_server_that_robots_share(machine: Machine, colony: Colony) -> None:
    fleet = machine.start("serve", "DServer", "--robot", "fleet")
    until(lambda: fleet.ended() or "listens at" in fleet.err, "DServer listens")
    alone = colony("stop")
    assert (alone.code, alone.out) == (2, "")
    assert "no robot runs on this machine that has a base; found fleet" in alone.err
    base = machine.start("serve", "RServer", "--robot", ROBOT)
    until(lambda: base.ended() or "listens at" in base.err, "RServer listens")
    unkept = colony("stop")
    assert (unkept.code, unkept.out) == (1, f"{ROBOT}: stopped; acknowledged by RServer\n")
    assert "the Clock is down" in unkept.err
    clock = machine.start("serve", "Clock", "--robot", ROBOT)
    until(lambda: clock.ended() or "listens at" in clock.err, "the Clock listens")
    both = colony("stop")
    assert (both.code, both.err) == (0, "")
    assert both.out.startswith(f"{ROBOT}: stopped by ")
    assert both.out.endswith("; acknowledged by Clock, RServer\n")
    assert colony("stop", "--robot", "fleet").code == 1
    for one in (fleet, base, clock):
        one.tell(signal.SIGINT)
        assert one.wait() == 0


def test_trouble_with_one_robot_keeps_no_other_from_being_stopped(machine: Machine, colony: Colony) -> None:
    started = [machine.start("serve", server, "--robot", "siena") for server in ("Clock", "RServer")]
    for one in started:
        until(lambda one=one: one.ended() or "listens at" in one.err, "it listens")  # type: ignore[misc]
    other = machine.start("serve", "Clock", "--robot", "arezzo")
    until(lambda: other.ended() or "listens at" in other.err, "it listens")
    with Session.open("siena", environment=machine.environment) as session:
        until(lambda: {"Clock", "RServer"} <= set(session.servers()), "both are there")
        folder = machine.directory.path.parent / "arezzo"
        folder.chmod(0o755)
        try:
            both = colony("stop")
        finally:
            folder.chmod(0o700)
        assert both.code == 1
        assert both.out.startswith("siena: stopped by ")
        assert "arezzo is open to others" in both.err
    for one in (*started, other):
        one.tell(signal.SIGINT)
        assert one.wait() == 0


SERVE_ALL = ("serve", "all", "--robot", "r", "--map", MAP)
USERS = ("--connect", "tls/x:1", "--security", "f")

BAD_OPTIONS: list[tuple[tuple[str, ...], str]] = [
    (("serve", "all", "--robot", "r"), "all requires --map MAP"),
    (("serve", "Gateway", "--robot", "r"), "Gateway requires --listen"),
    (("serve", "CServer", "--robot", "r"), "CServer requires one --camera"),
    (
        ("serve", "RServer", "--robot", "r", "--listen", "tls/x:1"),
        "--listen and --security require each other",
    ),
    (("serve", "XServer", "--robot", "r"), "'XServer' is not one of"),
    (("serve", "RServer", "--robot", "a/b"), "`a/b` cannot be the name of a robot"),
    (("serve", "all", "--robot", "r", "--map", "nowhere"), "nowhere:1:1: error[M001]: cannot read the map"),
    (("ps", "--robot", "a/b"), "`a/b` cannot be the name of a robot"),
    (("stop", "--robot", "a/b"), "`a/b` cannot be the name of a robot"),
    (("stop", "--robot", "a/b", *USERS), "`a/b` cannot be the name of a robot"),
    (("data", "list", "--robot", "a/b"), "`a/b` cannot be the name of a robot"),
    (("serve", "Clock", "--robot", "r", "--state", ""), "found an empty name; expected the name of a folder"),
    ((*SERVE_ALL, "--listen", "tls/localhost:0", "--security", "/dev/zero"), "it is not a regular file"),
    ((*SERVE_ALL, "--listen", "tcp/localhost:0", "--security", "f"), "is unencrypted"),
    (("run", WANDER, "--robot", "", "--connect"), "`` cannot be the name of a robot"),
    (("stop",), "no robot runs on this machine"),
    (("stop", "--robot", "r"), "no robot `r` on this machine"),
    (("ps", "--connect", "tls/x:1"), "requires --robot NAME"),
    (("ps", "--robot", "r", "--connect", "tls/x:1"), "requires --security"),
]


@pytest.mark.parametrize(("arguments", "expected"), BAD_OPTIONS, ids=[" ".join(a) for a, _ in BAD_OPTIONS])
def test_options_that_make_no_sense(
    machine: Machine, colony: Colony, arguments: tuple[str, ...], expected: str
) -> None:
    result = colony(*arguments)
    assert result.code == 2
    assert expected in result.err
    assert len(result.err.splitlines()) == 1


def test_no_robot_is_no_error_but_told_by_the_exit_code(machine: Machine, colony: Colony) -> None:
    assert colony("ps")[:2] == (1, "no robot runs on this machine\n")
    assert colony("ps", "--robot", "r", "--format", "json")[:2] == (1, "[]\n")
