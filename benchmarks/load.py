"""Processor time that a robot of processes takes a frame, beside a floor of bare zenoh.

`colony run --processes` drives a behavior in a simulated building, with recording and monitor on, by the wall
clock, in frames of 50 ms. The floor is seven bare processes that exchange the most necessary of these
messages and do nothing else (benchmarks/floor.py): a lower bound. Both are measured in turns. Where the time
goes is from another run, with clocks in every process (benchmarks/parts.py), over the same frames as its
totals.

    python -m benchmarks.load                     both behaviors, and the floor
    python -m benchmarks.load wander --isolate    one, with options of `colony run`, which come last
"""

from __future__ import annotations

import itertools
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
from colony.runtime.kit.errors import RobotConnectionError, ServerNotFoundError
from colony.runtime.library.leader import LEADER, RunStatus, run_status

BEHAVIORS = ("wander", "navigator")

WARM_UP = 80
"""Frames of a run before the ones that are measured."""

FRAMES = 300
"""Frames that are measured."""

ROUNDS = 3
"""Measurements of each behavior, and of the floor."""

FLOOR_S = 12.0
"""Seconds for which the floor is measured."""

STARTS_S = 60.0
"""Seconds after which a run that has not begun is given up, and a process that does not tell its parts."""

TARGET_MS = {"wander": 6.0, "navigator": 9.0}
TARGET_RATIO = {"wander": 1.8, "navigator": 2.7}
TARGET_MB = 400.0

Milliseconds = dict[str, float]


class Load(NamedTuple):
    """What a robot of processes took.

    Attributes:
        ms: milliseconds of processor time a frame, by process.
        mb: unshared megabytes, by process.
        unheard: requests that were late or lost, of all clients and frames.
        by_part: milliseconds a frame by part, by process; empty without clocks.
    """

    ms: Milliseconds
    mb: dict[str, float]
    unheard: int
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
    with (
        scratch() as folder,
        _running(behavior, folder, options, with_parts) as (process, session),
        _leader(session) as leader,
    ):
        before = _status(process, leader, leader.do(run_status()).frames + WARM_UP)
        began, parts_began = _spent(process.pid), _parts(process, folder) if with_parts else {}
        after = _status(process, leader, before.frames + FRAMES)
        ended, parts_ended = _spent(process.pid), _parts(process, folder) if with_parts else {}
        mb = _unshared(process.pid)
    frames = after.frames - before.frames
    unheard = sum(c.late + c.lost for c in after.clients) - sum(c.late + c.lost for c in before.clients)
    by_part = {name: _a_frame(spent, parts_began[name], frames) for name, spent in parts_ended.items()}
    return Load(_a_frame(ended, began, frames), mb, unheard, by_part)


def _a_frame(ended: Milliseconds, began: Milliseconds, frames: int) -> Milliseconds:
    return {name: (spent - began.get(name, 0.0)) / frames for name, spent in ended.items()}


@contextmanager
def _running(
    behavior: str, folder: Path, options: tuple[str, ...], with_parts: bool
) -> Iterator[tuple[subprocess.Popen[bytes], Session]]:
    (folder / "parts").mkdir()
    file, record = ROOT / "behaviors" / f"{behavior}.colony", folder / "run.mcap"
    modules = ("benchmarks.parts", "colony.cli.main") if with_parts else ("colony.cli.main",)
    process = colony_run(
        file,
        folder,
        "--duration",
        "60min",
        "--record",
        str(record),
        *options,
        modules=modules,
        environment={parts.FOLDER: str(folder / "parts")},
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
        except (ServerNotFoundError, RobotConnectionError):
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


def _parts(process: subprocess.Popen[bytes], folder: Path) -> dict[str, Milliseconds]:
    """Return the processor time that each process has taken so far, by part."""
    paths: dict[str, Path] = {}
    for pid, name in _tree(process.pid):
        paths[name] = folder / "parts" / f"{name}.json"
        paths[name].unlink(missing_ok=True)
        os.kill(pid, parts.TELL)
    until = time.monotonic() + STARTS_S
    while not all(path.exists() for path in paths.values()):
        expect_alive(process)
        if time.monotonic() > until:
            raise RuntimeError(f"not all of {', '.join(paths)} tell their parts")
        time.sleep(0.01)
    return {name: json.loads(path.read_text()) for name, path in paths.items()}


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
        rows += _part_rows(behavior, robot(behavior, with_parts=True))
    return rows


def _rows(behavior: str, loads: list[Load], bare: float) -> Iterator[Row]:
    middle = sorted(loads, key=lambda load: sum(load.ms.values()))[len(loads) // 2]
    total = sum(middle.ms.values())
    simulator = middle.ms["Simulator"]
    note = f"without the simulator {total - simulator:.2f} ms; median of {len(loads)}"
    yield row(f"{behavior}", total, "ms a frame", TARGET_MS[behavior], note)
    unheard = f"{sum(load.unheard for load in loads)} requests late or lost in {FRAMES * len(loads)} frames"
    yield row(f"{behavior} / floor", total / bare, "x", TARGET_RATIO[behavior], unheard)
    yield row(f"{behavior}: unshared memory", sum(middle.mb.values()), "MB", TARGET_MB, "")
    for name, ms in sorted(middle.ms.items(), key=lambda item: -item[1]):
        yield row(f"{behavior}: {name}", ms, "ms a frame", None, f"{middle.mb[name]:.0f} MB")


def _part_rows(behavior: str, load: Load) -> Iterator[Row]:
    """Yield where the time of each process goes, from a run with clocks: a row a process. The rest is what
    has no clock: zenoh's threads, switches between threads, and all other Python."""
    for name, ms in sorted(load.ms.items(), key=lambda item: -item[1]):
        known = load.by_part.get(name, {})
        if known:
            rest = max(0.0, ms - sum(known.values()))
            shown = [*sorted(known.items(), key=lambda item: -item[1]), ("rest", rest)]
            note = ", ".join(f"{part} {spent:.2f}" for part, spent in shown if spent >= 0.005)
            yield row(f"{behavior}, with clocks: {name}", ms, "ms a frame", None, note)


def main() -> None:
    """Print what some behaviors, or all of the table, take."""
    behaviors = list(itertools.takewhile(lambda argument: not argument.startswith("-"), sys.argv[1:]))
    options = sys.argv[1 + len(behaviors) :]
    unknown = [name for name in behaviors if name not in BEHAVIORS]
    if unknown:
        expected = f"{' or '.join(BEHAVIORS)}, then options of `colony run`"
        sys.exit(f"load: found {', '.join(unknown)}; expected {expected}")
    rows = [] if behaviors or options else run()
    for behavior in behaviors or (BEHAVIORS if options else ()):
        rows += _rows(behavior, [robot(behavior, *options)], floor_ms())
        rows += _part_rows(behavior, robot(behavior, *options, with_parts=True))
    for each in rows:
        print(f"{each['name']:36} {each['value']:7.2f} {each['unit']:10} {each['note']}")


if __name__ == "__main__":
    main()
