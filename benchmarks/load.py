"""What a live robot takes, with its servers and clients in one process, and with a process for each server.

`colony run --processes` drives a behavior in a simulated building, with recording and monitor on, by the wall
clock, in frames of 50 ms. Both layouts are measured in turns: processor time a frame of all processes but the
simulator, their memory (a page that several share counts in parts), switches between threads, how long after
its tick a command is at the driver, and requests that were late or lost.

    python -m benchmarks.load             both behaviors
    python -m benchmarks.load wander      one
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

from benchmarks import latency
from benchmarks.processes import ROOT, Row, colony_run, expect_alive, row, scratch
from colony.runtime.kit.connection import Connection, Session
from colony.runtime.kit.errors import RobotConnectionError, ServerNotFoundError
from colony.runtime.library.leader import LEADER, RunStatus, run_status

BEHAVIORS = ("wander", "navigator")

LAYOUTS: dict[str, tuple[str, ...]] = {"one process": (), "isolated": ("--isolate",)}
"""Options of `colony run` by layout."""

WARM_UP = 80
"""Frames of a run before the ones that are measured."""

FRAMES = 300
"""Frames that are measured."""

ROUNDS = 3
"""Measurements of each behavior in each layout."""

STARTS_S = 60.0
"""Seconds after which a run is given up that has not begun, or does not tell its latencies."""

TARGET_MS = {"wander": 4.0, "navigator": 5.0}
TARGET_RATIO = {"wander": 0.40, "navigator": 0.45}
TARGET_MB = 120.0
TARGET_MEMORY_RATIO = 0.55
TARGET_MEDIAN_MS, TARGET_P99_MS = 1.5, 5.0

SIMULATOR = "Simulator"


class Load(NamedTuple):
    """What a robot took: all of its processes but the simulator.

    Attributes:
        ms: milliseconds of processor time a frame.
        simulator_ms: the same of the simulator.
        mb: proportional megabytes.
        switches: switches between threads a frame.
        latencies_ms: milliseconds from a tick to the command at the driver, in order of size.
        unheard: requests that were late or lost, of all clients and frames.
    """

    ms: float
    simulator_ms: float
    mb: float
    switches: float
    latencies_ms: list[float]
    unheard: int


def robot(behavior: str, *options: str) -> Load:
    """Run a behavior and measure it after its start-up."""
    with (
        scratch() as folder,
        _running(behavior, folder, options) as (process, session),
        _leader(session) as leader,
    ):
        before = _status(process, leader, leader.do(run_status()).frames + WARM_UP)
        _latencies(process, folder)
        began = _spent(process.pid)
        after = _status(process, leader, before.frames + FRAMES)
        ended = _spent(process.pid)
        latencies = _latencies(process, folder)
        mb = sum(_memory_mb(pid) for pid, name in _tree(process.pid) if name != SIMULATOR)
    frames = after.frames - before.frames
    unheard = sum(c.late + c.lost for c in after.clients) - sum(c.late + c.lost for c in before.clients)

    def a_frame(value: int, *, simulator: bool) -> float:
        took = (
            ended[pid][1 + value] - began[pid][1 + value]
            for pid in began
            if pid in ended
            if (ended[pid][0] == SIMULATOR) is simulator
        )
        return sum(took) / frames

    return Load(
        ms=a_frame(0, simulator=False),
        simulator_ms=a_frame(0, simulator=True),
        mb=mb,
        switches=a_frame(1, simulator=False),
        latencies_ms=sorted(latencies),
        unheard=unheard,
    )


@contextmanager
def _running(
    behavior: str, folder: Path, options: tuple[str, ...]
) -> Iterator[tuple[subprocess.Popen[bytes], Session]]:
    (folder / "latency").mkdir()
    file, record = ROOT / "behaviors" / f"{behavior}.colony", folder / "run.mcap"
    process = colony_run(
        file,
        folder,
        "--duration",
        "60min",
        "--record",
        str(record),
        *options,
        modules=("benchmarks.latency", "colony.cli.main"),
        environment={latency.FOLDER: str(folder / "latency")},
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


def _spent(parent: int) -> dict[int, tuple[str, float, float]]:
    """Return name, milliseconds of processor time and switches so far, of all threads, by process."""
    return {pid: (name, *_of_threads(pid)) for pid, name in _tree(parent)}


def _of_threads(pid: int) -> tuple[float, float]:
    ms = switches = 0.0
    for task in Path(f"/proc/{pid}/task").iterdir():
        ms += int((task / "schedstat").read_text().split()[0]) / 1e6
        switches += sum(map(int, re.findall(r"ctxt_switches:\s+(\d+)", (task / "status").read_text())))
    return ms, switches


def _latencies(process: subprocess.Popen[bytes], folder: Path) -> list[float]:
    """Return the milliseconds from tick to driver of the commands since the last call."""
    told = folder / "latency"
    for path in told.glob("*.json"):
        path.unlink()
    until = time.monotonic() + STARTS_S
    while not (found := [*told.glob("*.json")]):
        expect_alive(process)
        if time.monotonic() > until:
            raise RuntimeError("no process tells how long its commands took")
        for pid, _ in _tree(process.pid):
            os.kill(pid, latency.TELL)
        time.sleep(0.1)
    ms: list[float] = json.loads(found[0].read_text())
    return ms


def _memory_mb(pid: int) -> float:
    text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    return sum(int(kb) for kb in re.findall(r"^Pss: +(\d+) kB", text, re.M)) / 1024


def run(behaviors: tuple[str, ...] | None = None) -> list[Row]:
    """Measure; a row has name, value, unit, target, ok and note. `target` is the most that `value` may be."""
    rows: list[Row] = []
    for behavior in behaviors or BEHAVIORS:
        loads: dict[str, list[Load]] = {layout: [] for layout in LAYOUTS}
        for _ in range(ROUNDS):
            for layout, options in LAYOUTS.items():
                loads[layout].append(robot(behavior, *options))
        rows += _rows(behavior, *loads.values())
    return rows


def _rows(behavior: str, composed: list[Load], isolated: list[Load]) -> Iterator[Row]:
    one, many = _middle(composed), _middle(isolated)
    for name, load, targets in (
        ("one process", one, (TARGET_MS[behavior], TARGET_MB, TARGET_MEDIAN_MS, TARGET_P99_MS)),
        ("isolated", many, (None,) * 4),
    ):
        loads = composed if load is one else isolated
        all_ms = sorted(ms for each in loads for ms in each.latencies_ms)
        unheard = (
            f"{sum(each.unheard for each in loads)} requests late or lost in {FRAMES * len(loads)} frames"
        )
        spent = f"the simulator besides {load.simulator_ms:.2f} ms; median of {len(loads)}; {unheard}"
        yield row(f"{behavior}, {name}", load.ms, "ms a frame", targets[0], spent)
        yield row(f"{behavior}, {name}: memory", load.mb, "MB", targets[1], "without the simulator")
        p99 = all_ms[int(0.99 * len(all_ms))]
        yield row(
            f"{behavior}, {name}: tick to driver", statistics.median(all_ms), "ms", targets[2], "median"
        )
        yield row(f"{behavior}, {name}: tick to driver, 99 %", p99, "ms", targets[3], "")
        yield row(f"{behavior}, {name}: switches", load.switches, "a frame", None, "of threads")
    yield row(f"{behavior}: time, one / isolated", one.ms / many.ms, "x", TARGET_RATIO[behavior], "")
    yield row(f"{behavior}: memory, one / isolated", one.mb / many.mb, "x", TARGET_MEMORY_RATIO, "")


def _middle(loads: list[Load]) -> Load:
    return sorted(loads, key=lambda load: load.ms)[len(loads) // 2]


def main() -> None:
    """Print what some behaviors, or all of the table, take."""
    unknown = [name for name in sys.argv[1:] if name not in BEHAVIORS]
    if unknown:
        sys.exit(f"load: found {', '.join(unknown)}; expected {' or '.join(BEHAVIORS)}")
    for each in run(tuple(sys.argv[1:]) or BEHAVIORS):
        print(f"{each['name']:44} {each['value']:7.2f} {each['unit']:10} {each['note']}")


if __name__ == "__main__":
    main()
