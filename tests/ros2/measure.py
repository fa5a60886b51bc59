"""Latency and processor time of a served robot of topics: `python -m tests.ros2.measure`.

The foreign robot publishes scans of 360 beams and odometry at 20 Hz. Latency is from the publication of the
first scan in which something is near to the arrival of the first twist that turns away, at the foreign robot.
"""

from __future__ import annotations

import os
import random
import statistics
import sys
import tempfile
import time
from contextlib import closing
from functools import partial
from pathlib import Path

from tests.cli.machine import children_of
from tests.ros2.ros import Foreign, Ros
from tests.ros2.test_served import Served
from tests.waiting import until

TRIALS = 100


def latencies_ms(served: Served, trials: int) -> list[float]:
    """Return the time of each reaction."""
    robot, chance, found = served.robot, random.Random(1), []
    for _ in range(trials):
        robot.set(near=True)
        until(lambda: robot.near and robot.near[-1][0], "something is near")
        began_ns = robot.near[-1][1]
        turned_ns = until(partial(_first_turn, robot, began_ns), "it turns")
        found.append((turned_ns - began_ns) / 1e6)
        robot.set(near=False)
        until(lambda: not robot.near[-1][0] and robot.drives(), "it drives on")
        time.sleep(chance.uniform(0.1, 0.15))
    return found


def _first_turn(robot: Foreign, since_ns: int) -> int | None:
    return next((row["t"] for row in robot.since(since_ns) if row["w"]), None)


def share(pid: int, seconds: float) -> float:
    """Return the part of a core that a process takes."""

    def taken() -> int:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return int(fields[11]) + int(fields[12])

    before, began = taken(), time.monotonic()
    time.sleep(seconds)
    return (taken() - before) / os.sysconf("SC_CLK_TCK") / (time.monotonic() - began)


def main() -> None:
    with tempfile.TemporaryDirectory() as folder, closing(Ros(Path(folder))) as ros:
        served = Served(ros, Path(folder))
        with closing(served.machine):
            until(served.drives, "it drives")
            (bridge,) = children_of(served.pid("RServer"))
            for name, pid in (("bridge", bridge), ("servers on topics", served.pid("RServer"))):
                print(f"{name}: {100 * share(pid, 20.0):.1f} % of a core")
            found = sorted(latencies_ms(served, int(sys.argv[1]) if sys.argv[1:] else TRIALS))
            last = found[int(0.99 * len(found)) - 1]
            print(f"scan to command: median {statistics.median(found):.1f} ms, 99 % {last:.1f} ms")


if __name__ == "__main__":
    main()
