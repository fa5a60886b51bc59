"""A served base stops when a process that has to do with driving dies or stands still, and else drives on.

`python -m benchmarks stops_on_wire` measures how soon; here the order of commands counts.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.drivers.served_base import CREATE2, Served, pioneer_at, served
from tests.waiting import until

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def create2(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(CREATE2, tmp_path_factory.mktemp("c")) as base:
        yield base


def leader(base: Served) -> int:
    return base.leader.pid


FROZEN: dict[str, Callable[[Served], int]] = {
    "RServer": lambda base: base.pid("RServer"),
    "Clock": lambda base: base.pid("Clock"),
    "leader": leader,
}


@pytest.mark.parametrize("name", FROZEN)
def test_a_frozen_process_stops_the_base_until_it_goes_on(create2: Served, name: str) -> None:
    create2.drive()
    pid = FROZEN[name](create2)
    os.kill(pid, signal.SIGSTOP)
    then = time.monotonic()
    try:
        until(lambda: create2.robot.stood(then), "the base is stopped")
    finally:
        os.kill(pid, signal.SIGCONT)
    create2.drive()


@pytest.mark.parametrize("name", FROZEN)
def test_a_killed_process_stops_the_base_first_of_all(create2: Served, name: str) -> None:
    create2.drive()
    then = time.monotonic()
    os.kill(FROZEN[name](create2), signal.SIGKILL)
    until(lambda: create2.robot.stood(then), "the base is stopped")
    create2.drive()


def test_a_frozen_supervisor_changes_nothing(create2: Served) -> None:
    create2.drive()
    os.kill(create2.supervisor.pid, signal.SIGSTOP)
    try:
        then = len(create2.robot.heard)
        until(lambda: len(create2.robot.heard) > then + 40, "the base hears forty frames")
        assert create2.moves()
    finally:
        os.kill(create2.supervisor.pid, signal.SIGCONT)


def test_a_pulled_cable_and_a_killed_guard(tmp_path: Path) -> None:
    """The watchdog of a Pioneer stops it; the first that it hears afterwards is to stand."""
    with served(pioneer_at(38_400), tmp_path) as base:
        base.drive()
        base.emulator.pull_out()
        until(lambda: base.base.stops_itself(base.robot.robot), "its watchdog stops it")
        then = len(base.robot.heard)
        base.emulator.plug_in()
        until(lambda: len(base.robot.heard) > then, "it is heard again")
        assert not any(base.robot.heard[then][1])
        base.drive()
        guard = base.guard
        then = len(base.robot.heard)
        os.kill(guard, signal.SIGKILL)
        until(lambda: any(not any(points) for _, points in base.robot.heard[then:]), "its successor stops it")
        base.drive()
        assert base.guard != guard
