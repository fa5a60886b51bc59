"""Measures what watching costs a robot: `python -m tools.watch_cost --seconds 30`.

In one run of processes it prints, without a watcher, with one that five pages read, and with one that is
frozen (SIGSTOP), the processor time of the robot's processes, and the frames in which a client was late.
"""

from __future__ import annotations

import argparse
import os
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Thread

from colony.runtime.library.leader import RunStatus
from tests.cli.machine import MAP, ROBOT, WANDER, Machine, Started, children_of, status
from tests.waiting import until
from tests.watch.runs import page

READERS = 5


def used_s(pids: list[int]) -> float:
    """Return the processor time that processes have used, in seconds."""
    total = 0
    for pid in pids:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        total += int(fields[11]) + int(fields[12])
    return total / os.sysconf("SC_CLK_TCK")


def late(found: RunStatus) -> int:
    return sum(client.late + client.lost for client in found.clients)


@contextmanager
def watched(machine: Machine) -> Iterator[Started]:
    """Watch the robot with several pages that read what they are sent."""
    watcher = machine.start("watch", "--robot", ROBOT, "--port", "0")
    until(lambda: watcher.ended() or "http" in watcher.out, "the page is served")
    assert not watcher.ended(), watcher.err
    host, token = watcher.out.split()[-1].removeprefix("http://").split("/#")
    ended = Event()

    def read() -> None:
        with page(host, token=token) as opened:
            while not ended.is_set():
                opened.until(lambda message: "snapshot" in message)

    with ExitStack() as threads:
        for _ in range(READERS):
            thread = Thread(target=read)
            thread.start()
            threads.callback(thread.join)
        threads.callback(ended.set)
        time.sleep(3)
        yield watcher
        watcher.tell(signal.SIGCONT)


def measure(machine: Machine, seconds: float, rounds: int) -> None:
    """Measure, and print."""
    run = machine.start("run", WANDER, "--map", MAP, "--processes", "--no-picture", "--duration", "100000")
    until(lambda: run.ended() or machine.moves(), "the robot drives")
    with machine.session() as session:
        pids = [run.pid, *children_of(run.pid)]

        def row(name: str) -> None:
            before, frames = used_s(pids), status(session)
            began = time.monotonic()
            time.sleep(seconds)
            after = status(session)
            assert frames is not None
            assert after is not None
            took, n = time.monotonic() - began, after.frames - frames.frames
            share = 100 * (used_s(pids) - before) / took
            print(
                f"{name:28} {share:6.1f} % of a core, {late(after) - late(frames):4} late in {n} frames",
                flush=True,
            )

        row("no watcher")
        with watched(machine) as watcher:
            for _ in range(rounds):
                own, began = used_s([watcher.pid]), time.monotonic()
                row(f"a watcher with {READERS} pages")
                share = 100 * (used_s([watcher.pid]) - own) / (time.monotonic() - began)
                print(f"{'(the watcher itself)':28} {share:6.1f} % of a core")
                watcher.tell(signal.SIGSTOP)
                row("the same, frozen")
                watcher.tell(signal.SIGCONT)
        row("no watcher again")


def main() -> None:
    """Run as a script."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--rounds", type=int, default=3)
    chosen = parser.parse_args()
    with TemporaryDirectory() as folder:
        machine = Machine(Path(folder), XDG_CACHE_HOME=folder)
        try:
            measure(machine, chosen.seconds, chosen.rounds)
        finally:
            machine.close()


if __name__ == "__main__":
    main()
