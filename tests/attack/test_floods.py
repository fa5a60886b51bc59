"""An emergency stop gets through every flood, and no server is lost to the gateway."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from colony.runtime.library import robot
from colony.runtime.transport.live.limits import MAX_SESSIONS, RECEIVING_THREADS
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.robot_address import Remote
from tests.cli.machine import ROBOT
from tests.sampling import sampled
from tests.waiting import until
from tools.attack.flood import KINDS, Kind, flood
from tools.attack.lab import Lab
from tools.attack.stops import stop_times

SECONDS = 2.0
STOPS = 5


@contextmanager
def _losses(lab: Lab) -> Iterator[list[str]]:
    """The servers that the gateway lost until the end of the block."""
    remote = Remote(robot=ROBOT, endpoint=lab.endpoint, credentials=lab.authority.user("reader"))
    with ZenohSession.open(remote) as network:
        until(lambda: "RServer" in network.alive(), "the gateway has found the server")
        lost: list[str] = []
        network.watch(lambda address, present: None if present else lost.append(address))
        yield lost


@pytest.mark.parametrize("kind", sampled(KINDS, every=4, thorough=True))
def test_a_stop_gets_through(kind: Kind, lab: Lab) -> None:
    with (
        lab.session("guard") as guard,
        lab.machine.session() as home,
        _losses(lab) as lost,
        flood(lab, kind, seconds=SECONDS) as running,
    ):
        took = list(stop_times(guard, home, STOPS))
        assert running.end() > 0
        assert len(took) == STOPS
        assert lost == []
    assert lab.machine.stands()


def test_a_stop_gets_through_a_flood_of_many_sessions(lab: Lab) -> None:
    """The sessions of a flood keep the gateway's receiving threads busy, but for those of other sessions."""
    names = [task.read_text() for task in Path(f"/proc/{lab.pid('Gateway')}/task").glob("*/comm")]
    assert sum(name.startswith("rx") for name in names) >= RECEIVING_THREADS == MAX_SESSIONS
    with (
        lab.session("guard") as guard,
        lab.machine.session() as home,
        _losses(lab) as lost,
        flood(lab, "command calls", seconds=SECONDS, sessions=15, batched=True) as running,
    ):
        assert len(list(stop_times(guard, home, STOPS))) == STOPS
        assert running.end() > 0
        assert lost == []


@pytest.mark.parametrize("server", ["RServer", "DServer"])
def test_a_server_that_was_killed_is_found_again(server: str, lab: Lab) -> None:
    with lab.session("reader") as session, session.connect("RServer", timeout_s=60.0) as base:
        base.do(robot.position())
        old = lab.pid(server)
        os.kill(old, signal.SIGKILL)
        lab.restarted(server, old)
        until(lambda: server in session.servers(), "the gateway has found it again")
        assert base.do(robot.position()) is not None


def test_a_server_that_was_frozen_is_found_again(lab: Lab) -> None:
    with lab.session("reader") as session, session.connect("RServer", timeout_s=60.0) as base:
        base.do(robot.position())
        pid = lab.pid("RServer")
        os.kill(pid, signal.SIGSTOP)
        try:
            until(lambda: "RServer" not in session.servers(), "its lease is over")
        finally:
            os.kill(pid, signal.SIGCONT)
        until(lambda: "RServer" in session.servers(), "the gateway has found it again")
        assert lab.pid("RServer") == pid
        base.do(robot.position())
