"""Processor time that a robot of processes takes a frame, beside a floor of bare zenoh.

`colony run --processes` drives a behavior in a simulated building, with recording and monitor on, by the wall
clock, in frames of 50 ms. The floor is seven processes that exchange messages of the same number and size and
do nothing else (benchmarks/floor.py). Both are measured in turns. Where the time goes is from another run,
with clocks in every process (benchmarks/parts.py).

    python -m benchmarks.load                     both behaviors, and the floor
    python -m benchmarks.load wander --isolate    one, with options of `colony run`
"""

from __future__ import annotations

import json
import os
import re
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from benchmarks import floor, parts
from benchmarks.processes import ROOT, Row, colony_run, expect_alive, row, scratch
from colony.runtime.kit.connection import Connection, Session
from colony.runtime.kit.errors import ConnectionProblem, ServerNotFound
from colony.runtime.library.leader import LEADER, RunStatus, run_status

BEHAVIORS = ("wander", "navigator")
WARM_UP = 80
FRAMES = 300
ROUNDS = 3
FLOOR_S = 12.0
STARTS_S = 60.0
TARGET_MS = {"wander": 6.0, "navigator": 9.0}
TARGET_RATIO = {"wander": 1.8, "navigator": 2.7}
TARGET_MB = 400.0

Milliseconds = dict[str, float]


class Load(NamedTuple):
    """What a robot of processes took: milliseconds of processor time a frame and unshared megabytes, by
    process; in how many of the frames a client was late; milliseconds a frame by part, by process."""

    ms: Milliseconds
    mb: dict[str, float]
    late: int
    by_part: dict[str, Milliseconds]


def floor_ms() -> float:
    """Return milliseconds of processor time that the bare processes take a tick, all together."""
    with scratch() as folder:
        begun = [
            subprocess.Popen(
                [sys.executable, "-m", "benchmarks.floor", name, str(folder), str(FLOOR_S)],
                stdout=subprocess.PIPE,
                cwd=ROOT,
            )
            for name in floor.HEARS
        ]
        return float(sum(json.loads(process.communicate()[0])["ms"] for process in begun))


def robot(behavior: str, *options: str, with_parts: bool = False) -> Load:
    """Run a behavior by processes and measure it after its start-up."""
    with scratch() as folder:
        with (
            _running(behavior, folder, options, with_parts) as (process, session),
            _leader(session) as leader,
        ):
            before = _status(process, leader, leader.do(run_status()).frames + WARM_UP)
            began = _spent(process.pid)
            after = _status(process, leader, before.frames + FRAMES)
            ended, mb = _spent(process.pid), _unshared(process.pid)
        by_part = {path.stem: json.loads(path.read_text()) for path in folder.glob("parts/*.json")}
    frames = after.frames - before.frames
    late = sum(c.late for c in after.clients) - sum(c.late for c in before.clients)
    ms = {name: (ended[name] - began.get(name, 0.0)) / frames for name in ended}
    all_frames = after.frames
    shares = {of: {part: spent / all_frames for part, spent in p.items()} for of, p in by_part.items()}
    return Load(ms, mb, late, shares)


@contextmanager
def _running(
    behavior: str, folder: Path, options: tuple[str, ...], with_parts: bool
) -> Iterator[tuple[subprocess.Popen[bytes], Session]]:
    (folder / "parts").mkdir()
    os.environ[parts.FOLDER] = str(folder / "parts")
    file, record = ROOT / "behaviors" / f"{behavior}.colony", folder / "run.mcap"
    modules = ("benchmarks.parts", "colony.cli.main") if with_parts else ("colony.cli.main",)
    process = colony_run(
        file, folder, "--duration", "60min", "--record", str(record), *options, modules=modules
    )
    environment = {**os.environ, "COLONY_RUN_DIR": str(folder / "r")}
    try:
        while not record.exists():
            expect_alive(process)
            time.sleep(0.01)
        with Session.open("rome", environment=environment) as session:
            yield process, session
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


def _leader(session: Session) -> Connection:
    until = time.monotonic() + STARTS_S
    while True:
        try:
            return session.connect(LEADER)
        except (ServerNotFound, ConnectionProblem):
            if time.monotonic() > until:
                raise
            time.sleep(0.05)


def _status(process: subprocess.Popen[bytes], leader: Connection, frames: int) -> RunStatus:
    """Wait until the run has had so many frames."""
    while (status := leader.do(run_status())).frames < frames:
        expect_alive(process)
        time.sleep(0.2)
    return status


def _tree(parent: int) -> Iterator[tuple[int, str]]:
    """Yield a process and those that it started, with their names."""
    yield parent, "leader"
    for task in Path(f"/proc/{parent}/task").iterdir():
        for child in (task / "children").read_text().split():
            words = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
            yield int(child), Path(os.fsdecode(words[-2])).stem


def _spent(parent: int) -> Milliseconds:
    """Return the processor time that each process has taken so far, all of its threads."""
    spent: Milliseconds = {}
    for pid, name in _tree(parent):
        tasks = Path(f"/proc/{pid}/task").iterdir()
        spent[name] = sum(int((task / "schedstat").read_text().split()[0]) for task in tasks) / 1e6
    return spent


def _unshared(parent: int) -> dict[str, float]:
    found: dict[str, float] = {}
    for pid, name in _tree(parent):
        text = Path(f"/proc/{pid}/smaps_rollup").read_text()
        found[name] = sum(int(n) for n in re.findall(r"^Private_\w+: +(\d+) kB", text, re.M)) / 1024
    return found


def run() -> list[Row]:
    """Measure; a row has name, value, unit, target, ok and note. `target` is the most that `value` may be."""
    floors: list[float] = []
    loads: dict[str, list[Load]] = {behavior: [] for behavior in BEHAVIORS}
    for _ in range(ROUNDS):
        floors.append(floor_ms())
        for behavior in BEHAVIORS:
            loads[behavior].append(robot(behavior))
    bare = statistics.median(floors)
    rows = [row("floor: seven bare processes", bare, "ms a frame", None, "median of 3")]
    for behavior in BEHAVIORS:
        rows += _rows(behavior, loads[behavior], bare)
        rows += _shares(behavior, robot(behavior, with_parts=True))
    return rows


def _rows(behavior: str, loads: list[Load], bare: float) -> Iterator[Row]:
    middle = sorted(loads, key=lambda load: sum(load.ms.values()))[len(loads) // 2]
    total = sum(middle.ms.values())
    simulator = middle.ms["Simulator"]
    note = f"without the simulator {total - simulator:.2f} ms; median of {len(loads)}"
    yield row(f"{behavior}", total, "ms a frame", TARGET_MS[behavior], note)
    late = f"{sum(load.late for load in loads)} late in {FRAMES * len(loads)} frames"
    yield row(f"{behavior} / floor", total / bare, "x", TARGET_RATIO[behavior], late)
    yield row(f"{behavior}: unshared memory", sum(middle.mb.values()), "MB", TARGET_MB, "")
    for name, ms in sorted(middle.ms.items(), key=lambda item: -item[1]):
        yield row(f"{behavior}: {name}", ms, "ms a frame", None, f"{middle.mb[name]:.0f} MB")


def _shares(behavior: str, load: Load) -> Iterator[Row]:
    """Where the time of each process goes, from a run with clocks: a row a process."""
    for name, ms in sorted(load.ms.items(), key=lambda item: -item[1]):
        known = load.by_part.get(name, {})
        if known:
            rest = max(0.0, ms - sum(known.values()))
            shown = [*sorted(known.items(), key=lambda item: -item[1]), ("zenoh, threads, system", rest)]
            note = ", ".join(f"{part} {spent:.2f}" for part, spent in shown if spent >= 0.005)
            yield row(f"{behavior}, with clocks: {name}", ms, "ms a frame", None, note)


def main() -> None:
    """Print what one behavior, or all of the table, takes."""
    behaviors = [name for name in sys.argv[1:] if name in BEHAVIORS]
    options = [name for name in sys.argv[1:] if name not in BEHAVIORS]
    rows = run() if len(sys.argv) == 1 else []
    for behavior in behaviors:
        rows += _rows(behavior, [robot(behavior, *options)], floor_ms())
        rows += _shares(behavior, robot(behavior, *options, with_parts=True))
    for each in rows:
        print(f"{each['name']:36} {each['value']:7.2f} {each['unit']:10} {each['note']}")


if __name__ == "__main__":
    main()
