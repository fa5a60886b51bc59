"""What an idle robot whose servers have one serial line costs: together, and with a process for each server.

An emulated Create 2 stands on a pseudoterminal and streams as a real one does. Its ten servers are served by
`colony serve all`, in which those of the line share a process, and then each by a `colony serve` of its own.
Measured is the processor time of all of these processes and the guard. No program runs.

    python -m benchmarks.one_line --seconds 20
"""

from __future__ import annotations

import argparse
import os
import time
from contextlib import closing
from pathlib import Path

from benchmarks.processes import Row, busy, row, scratch
from colony.body.shipped import shipped_body
from colony.drivers.emulator import Emulator
from colony.runtime.transport.live.run_directory import RunDirectory
from tests.cli.machine import Machine, children_of, failed
from tests.drivers.served_base import CREATE2
from tests.waiting import until

SECONDS = 20.0

SETTLE_S = 5.0
"""Seconds from the time at which all servers are up and the device is ready."""

SHARE_MAX = 0.75
"""Greatest share of the time that the servers of one process may take of that of single ones."""


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _percent(folder: Path, commands: list[str], servers: set[str], seconds: float) -> float:
    """Return the processor time of a robot that these `colony serve` serve, in percent of a core."""
    emulator = Emulator(CREATE2.make(), baud=CREATE2.baud, link=folder / "port")
    with closing(emulator), closing(Machine(folder)) as machine:
        emulator.start()
        options = ("--robot", CREATE2.robot, "--port", emulator.port)
        started = [machine.start("serve", command, *options) for command in commands]
        runs = RunDirectory.find(machine.environment)
        robot = runs.robot(CREATE2.robot)
        until(lambda: failed(*started) or robot.running().keys() >= servers, "all servers are up")
        time.sleep(SETTLE_S)
        guard = int(Path(f"{runs.guard(emulator.port)}.lock").read_text())
        supervisors = {one.pid for one in started}
        pids = {
            guard,
            *robot.running().values(),
            *supervisors,
            *(c for p in supervisors for c in children_of(p)),
        }
        before, began = sum(map(_cpu_s, pids)), time.monotonic()
        time.sleep(seconds)
        return 100.0 * (sum(map(_cpu_s, pids)) - before) / (time.monotonic() - began)


def run(seconds: float | None = None) -> list[Row]:
    """Return the rows of the table."""
    seconds = SECONDS if seconds is None else seconds
    names = ["Clock", *shipped_body(CREATE2.robot).servers, "DServer", "Limits"]
    servers = set(names) - {"Limits"}
    with scratch() as folder:
        (folder / "together").mkdir()
        together = _percent(folder / "together", ["all"], servers, seconds)
        (folder / "apart").mkdir()
        apart = _percent(folder / "apart", names, servers, seconds)
    note = f"{together:.1f} % against {apart:.1f} %; {busy()}"
    return [
        row(f"{len(servers)} servers, idle, of a core", together, "%", None, busy()),
        row("servers of a line in one process / in one each", together / apart, "x", SHARE_MAX, note),
    ]


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=SECONDS)
    for each in run(parser.parse_args().seconds):
        print(f"{each['name']}: {each['value']:.3g} {each['unit']} ({each['note']})")


if __name__ == "__main__":
    main()
