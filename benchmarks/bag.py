"""A shadow of a minute of a robot in a bag: 360 beams, odometry and commands at 20 Hz, with a recording.

Measured is the processor time of `colony shadow --bag` as a whole process, and its greatest memory, of a bag
of a minute and of one that is longer: an hour may take 300 s, and memory may not grow.

    python -m benchmarks bag
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from subprocess import DEVNULL, Popen
from typing import NamedTuple

from benchmarks.processes import Row, row, scratch
from tests.ros2 import bag, burger

SECONDS = 60.0
LONGER = 5.0
"""Length of the longer bag in that of the shorter one."""

MINUTE_MAX_S = 5.0
GROWTH_MAX = 1.1


class _Used(NamedTuple):
    """The processor time in s of a process, and its greatest memory in MB."""

    cpu_s: float
    memory_mb: float


def _shadow(folder: Path, name: str, seconds: float) -> _Used:
    path = bag.write(folder / name, bag.hall(seconds))
    command = f"shadow roam.colony --robot burger --bag {path} --record {name}.recorded.mcap".split()
    started = Popen(
        [sys.executable, "-m", "colony.cli.main", *command], cwd=folder, stdout=DEVNULL, stderr=DEVNULL
    )
    _, status, usage = os.wait4(started.pid, 0)
    started.returncode = os.waitstatus_to_exitcode(status)
    assert started.returncode == 0, command
    return _Used(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024)


def run() -> list[Row]:
    """Return the rows of the table."""
    with scratch() as folder:
        interface = burger.INTERFACE.replace("ranges[72]", "ranges[360]").replace("step 5 deg", "step 1 deg")
        burger.write(folder, Path(sys.executable))
        (folder / "robots" / "burger" / "burger.colony").write_text(interface)
        short, long = _shadow(folder, "short", SECONDS), _shadow(folder, "long", LONGER * SECONDS)
    growth, note = long.memory_mb / short.memory_mb, f"{short.memory_mb:.0f} MB, then {long.memory_mb:.0f} MB"
    target = MINUTE_MAX_S * SECONDS / 60.0 + 2.0
    return [
        row(f"{SECONDS:g} s of a bag, of processor time", short.cpu_s, "s", target, "with its start"),
        row(f"memory of {LONGER:g} times as much", growth, "x", GROWTH_MAX, note),
    ]
