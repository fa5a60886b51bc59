"""Processor time that a robot of processes takes a frame, process by process, beside a floor of bare zenoh.

`colony run --processes` drives a behavior in a simulated building, with recording and monitor on, by the wall
clock. The floor is seven processes that exchange messages of the same number and size and do nothing else:
what any robot in Python over this transport costs. Both are measured in turns, on the same machine.

    python -m benchmarks.load                 wander and navigator
    python -m benchmarks.load wander --isolate
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from benchmarks.processes import LOOP, ROOT, scratch
from colony.runtime.kit.connection import Session
from colony.runtime.library.leader import LEADER, RunStatus, run_status

BEHAVIORS = ("wander", "navigator")
WARM_UP_S = 4.0
MEASURED_S = 15.0
ROUNDS = 3
FRAME_MS = 50.0
TARGET_MS = {"wander": 6.0, "navigator": 9.0}
TARGET_RATIO = {"wander": 1.8, "navigator": 2.7}
TARGET_MB = 400.0
TICK_MS = 1000 / os.sysconf("SC_CLK_TCK")


class Load(NamedTuple):
    """What a robot of processes took: milliseconds of processor time a frame and megabytes of memory of its
    own, by process; the frames counted, and how many of them a client was late for."""

    ms: dict[str, float]
    mb: dict[str, float]
    frames: int
    late: int


def robot(behavior: str, *options: str) -> Load:
    """Run a behavior by processes and measure it after its start-up."""
    with scratch() as folder, _running(behavior, folder, options) as (process, session):
        connection = _leader(session)
        with connection:
            until = connection.do(run_status()).frames + round(1000 * WARM_UP_S / FRAME_MS)
            before, began = _at(connection, until), _spent(process.pid)
            after = _at(connection, until + round(1000 * MEASURED_S / FRAME_MS))
            ended, mb = _spent(process.pid), _unshared(process.pid)
    frames = after.frames - before.frames
    late = sum(c.late for c in after.clients) - sum(c.late for c in before.clients)
    return Load({name: (ended[name] - began.get(name, 0.0)) / frames for name in ended}, mb, frames, late)


@contextmanager
def _running(
    behavior: str, folder: Path, options: tuple[str, ...]
) -> Iterator[tuple[subprocess.Popen[bytes], Session]]:
    environment = {**os.environ, "COLONY_RUN_DIR": str(folder / "r"), "PYTHONPATH": str(ROOT)}
    file, record = ROOT / "behaviors" / f"{behavior}.colony", folder / "run.mcap"
    arguments = ["run", str(file), "--map", str(LOOP), "--processes", "--no-picture", "--duration", "60min"]
    process = subprocess.Popen(
        [sys.executable, "-m", "colony.cli.main", *arguments, "--record", str(record), *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=environment,
    )
    try:
        while not record.exists():
            if process.poll() is not None:
                raise RuntimeError(f"the run ended with {process.returncode} before its first frame")
            time.sleep(0.01)
        with Session.open("rome", environment=environment) as session:
            yield process, session
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


def _leader(session: Session):
    from colony.runtime.kit.errors import ConnectionProblem, ServerNotFound

    while True:
        try:
            return session.connect(LEADER)
        except (ServerNotFound, ConnectionProblem):
            time.sleep(0.05)


def _at(connection, frames: int) -> RunStatus:
    """Wait until the run has had so many frames."""
    while (status := connection.do(run_status())).frames < frames:
        time.sleep(min(0.2, (frames - status.frames) * FRAME_MS / 1000))
    return status


def _tree(parent: int) -> Iterator[tuple[int, str]]:
    """The processes below one, with what they are."""
    yield parent, "leader"
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    for task in Path(f"/proc/{parent}/task").iterdir():
        if task.name != str(parent):
            children += (task / "children").read_text().split()
    for child in children:
        words = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
        yield int(child), Path(os.fsdecode(words[-2])).stem


def _spent(parent: int) -> dict[str, float]:
    """Milliseconds of processor time that each process has taken so far."""
    spent: dict[str, float] = {}
    for pid, name in _tree(parent):
        nanoseconds = sum(
            int((task / "schedstat").read_text().split()[0]) for task in Path(f"/proc/{pid}/task").iterdir()
        )
        spent[name] = nanoseconds / 1e6
    return spent


def _unshared(parent: int) -> dict[str, float]:
    found: dict[str, float] = {}
    for pid, name in _tree(parent):
        text = Path(f"/proc/{pid}/smaps_rollup").read_text()
        found[name] = sum(int(n) for n in re.findall(r"^Private_\w+: +(\d+) kB", text, re.M)) / 1024
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("behaviors", nargs="*", choices=(*BEHAVIORS, []), help="which (default: both)")
    known, options = parser.parse_known_args()
    for behavior in known.behaviors or BEHAVIORS:
        load = robot(behavior, *options)
        print(
            f"{behavior}: {sum(load.ms.values()):.2f} ms a frame, {sum(load.mb.values()):.0f} MB, "
            f"{load.late} late in {load.frames} frames"
        )
        for name, ms in sorted(load.ms.items(), key=lambda item: -item[1]):
            print(f"  {name:32} {ms:6.2f} ms {load.mb[name]:6.1f} MB")


if __name__ == "__main__":
    main()
