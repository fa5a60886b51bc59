"""Count acknowledged emergency stops that are forgotten: `python -m tools.stops_kept`.

Each trial has a robot of real processes, a Clock and RServer, whose state is on a small disk of its own. A
stop comes at a random moment; both servers are killed at random moments around it. The Clock alone is started
again: so what it knows is what the file told it.

    good        the disk has room
    full early  it is full before the Clock is started for the first time
    full late   it is filled when the Clock runs
    read-only   it is read-only, with a file of an earlier Clock or without
    corrupt     the file of an earlier Clock is damaged; the robot is released first, or is not

Prints a table. Exit code 1 if a stop was forgotten that had been acknowledged.
"""

from __future__ import annotations

import argparse
import random
import signal
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import Literal, get_args

import pytest

from colony.runtime.arbitration.stop_latch import FILE_BYTES, StopFile, StopState
from colony.runtime.kit.connection import Session
from colony.runtime.kit.emergency import StopButton
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.library import clock
from colony.runtime.library.clock import Participants
from colony.runtime.protocol.messages import Stopped
from colony.runtime.protocol.topics import CLOCK
from tests.cli.machine import ROBOT, Machine, Started, release
from tests.small_disk import SmallDisk, small_disk
from tests.waiting import until

Disk = Literal["good", "full early", "full late", "read-only", "corrupt"]
DISKS: tuple[Disk, ...] = get_args(Disk)

Fate = Literal["acknowledged", "refused", "unanswered"]
"""What became of a stop: exit code 0, "not kept", or nobody was there to answer."""

BEFORE_S, AFTER_S = 0.01, 0.06
"""Seconds around the press of a button in which a server is killed; a press takes about 0.01."""


class Trial:
    """One robot. Mutable: its servers."""

    def __init__(self, disk: Disk, draw: random.Random, machine: Machine, small: SmallDisk) -> None:
        self._disk, self._draw, self._machine, self._small = disk, draw, machine, small
        machine.environment["XDG_STATE_HOME"] = str(small.path)
        self._state = small.seen / "colony" / ROBOT
        self._state.mkdir(parents=True, mode=0o700)

    def run(self) -> tuple[Fate, bool]:
        """Return what became of the stop, and whether the Clock that is started afterwards knows of it."""
        self._prepare()
        servers = [self._start(CLOCK), self._start("RServer")]
        self._until_it_answers()
        if self._disk == "full late":
            self._small.fill()
        if self._disk == "corrupt" and self._draw.random() < 0.5:
            with self._machine.session() as session:
                release(session)
        fate = self._stop(servers)
        for server in servers:
            server.process.wait()
        self._start(CLOCK)
        return fate, self._until_it_answers().stopped is not None

    def _prepare(self) -> None:
        file = StopFile(self._state / "Clock.stop")
        match self._disk:
            case "full early":
                self._small.fill()
            case "read-only":
                if self._draw.random() < 0.5:
                    file.write(StopState(stopped=None, released_ns=-1))
                file.close()
                self._small.remount("ro")
            case "corrupt":
                earlier = Stopped(by="ann/1", t_ns=1)
                file.write(StopState(stopped=self._draw.choice((None, earlier)), released_ns=-1))
                file.close()
                self._damage(file.path)
            case "good" | "full late":
                pass

    def _damage(self, path: Path) -> None:
        content = bytearray(path.read_bytes())
        first = self._draw.randrange(FILE_BYTES)
        match self._draw.randrange(3):
            case 0:
                content[first] ^= 1 << self._draw.randrange(8)
            case 1:
                del content[first:]
            case _:
                content[first:] = bytes(FILE_BYTES - first)
        path.write_bytes(content)

    def _start(self, server: str) -> Started:
        started = self._machine.start("serve", server, "--robot", ROBOT, enter=self._small.inside)
        until(lambda: started.ended() or "listens at" in started.err, f"{server} listens")
        assert not started.ended(), started.err
        return started

    def _until_it_answers(self) -> Participants:
        def who() -> Participants | None:
            try:
                with self._machine.session() as session, session.connect(CLOCK, timeout_s=1.0) as connection:
                    return connection.do(clock.participants())
            except RobotConnectionError:
                return None

        found = until(who, "the Clock answers")
        assert found is not None
        return found

    def _stop(self, servers: list[Started]) -> Fate:
        with self._machine.session() as session, StopButton(session) as button:
            self._until_served(session)
            time.sleep(self._draw.uniform(0.0, 0.1))  # at any moment of a frame
            killers = self._killers(servers)
            time.sleep(BEFORE_S)
            try:
                pressed = button.press()
            finally:
                for killer in killers:
                    killer.join()
        if pressed.kept:
            return "acknowledged"
        return "refused" if "may lose the stop" in pressed.problems.get(CLOCK, "") else "unanswered"

    def _until_served(self, session: Session) -> None:
        until(lambda: {CLOCK, "RServer"} <= set(session.servers()), "both servers are there")

    def _killers(self, servers: list[Started]) -> list[threading.Timer]:
        """Begin to kill each server at a random moment around the press, which is `BEFORE_S` from now."""
        killers = [
            threading.Timer(self._draw.uniform(0.0, BEFORE_S + AFTER_S), s.tell, (signal.SIGKILL,))
            for s in servers
        ]
        for killer in killers:
            killer.start()
        return killers


def run_trial(disk: Disk, seed: str) -> tuple[Fate, bool]:
    """Make a robot, stop it, and take everything away again."""
    with ExitStack() as holds:
        folder = Path(holds.enter_context(tempfile.TemporaryDirectory(prefix="colony-stops-")))
        small = holds.enter_context(small_disk(folder / "disk", "64k"))
        machine = Machine(folder)
        holds.callback(machine.close)
        return Trial(disk, random.Random(seed), machine, small).run()


def table(rows: dict[Disk, Counter[str]]) -> str:
    """Return the results as a table of Markdown, with a row for each kind of disk."""
    columns = ("trials", *get_args(Fate), "forgotten")
    lines = [f"| disk | {' | '.join(columns)} |", f"|---{'|---' * len(columns)}|"]
    total: Counter[str] = sum(rows.values(), Counter())
    for name, row in [*rows.items(), ("all", total)]:
        lines.append(f"| {name} | {' | '.join(str(row[column]) for column in columns)} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description="count acknowledged stops that are forgotten")
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rows: dict[Disk, Counter[str]] = {disk: Counter() for disk in DISKS}
    for number in range(options.trials):
        disk = DISKS[number % len(DISKS)]
        try:
            fate, known = run_trial(disk, f"{options.seed} {number}")
        except pytest.skip.Exception as skipped:
            sys.exit(f"not measured: {skipped}")
        rows[disk].update({"trials": 1, fate: 1})
        if fate == "acknowledged" and not known:
            rows[disk]["forgotten"] += 1
            print(f"trial {number} of seed {options.seed}: forgotten, {disk}", file=sys.stderr)
    print(table(rows))
    sys.exit(any(row["forgotten"] for row in rows.values()))


if __name__ == "__main__":
    main()
