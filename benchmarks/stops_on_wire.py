"""How soon the stop is on the wire when the process that drives a base on a serial line dies or stands still.

A process drives the tiny robot of the tests over a pseudoterminal, 20 times a second, through the guard. It
is killed, or stopped as by a debugger, at a random time in its frame. Measured is the time from the last
command that the robot hears until the stop, on the monotonic clock of the pseudoterminal's other end.

    python -m benchmarks.stops_on_wire --rounds 50
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from colony.runtime.transport.live.run_directory import RunDirectory
from tests.drivers.tiny import SPEEDS, Tiny
from tests.drivers.tiny_robot import TinyRobot

Row = dict[str, object]

ROUNDS = 10
TARGET_MS = 250.0
PATIENCE_S = 60.0

DRIVER = """
import sys, time
from tests.drivers.tiny import base
driver = base(sys.argv[1])
while True:
    try:
        driver.drive(300.0, 0.0)
    except OSError:
        pass
    time.sleep(0.05)
"""


def _wait(condition: Callable[[], object]) -> None:
    until = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > until:
            raise TimeoutError("the base does not do what is expected")
        time.sleep(0.002)


def _stopped_after_ms(robot: TinyRobot, number: signal.Signals, rng: random.Random) -> float:
    """Drive, send the driver a signal, and return the milliseconds from the last command until the stop."""
    robot.heard.clear()
    driver = subprocess.Popen([sys.executable, "-c", DRIVER, os.fspath(robot.port)])
    try:
        _wait(lambda: robot.speeds == (300, 0))
        time.sleep(0.2 + rng.random() * 0.05)
        driver.send_signal(number)
        _wait(lambda: robot.speeds == (0, 0))
    finally:
        driver.kill()
        driver.wait()
    last = max(t for data, t in robot.heard if data[0] == SPEEDS and any(data[1:]))
    stop = next(t for data, t in robot.heard if t > last and data == Tiny.stop_bytes[2:-1])
    return 1000 * (stop - last)


def _measured(rounds: int) -> dict[str, list[float]]:
    rng = random.Random(1)
    found: dict[str, list[float]] = {"SIGKILL": [], "SIGSTOP": []}
    with tempfile.TemporaryDirectory() as folder:
        os.environ["COLONY_RUN_DIR"] = f"{folder}/r"
        robot = TinyRobot(Path(folder) / "port")
        try:
            for _ in range(rounds):
                for name, times in found.items():
                    times.append(_stopped_after_ms(robot, signal.Signals[name], rng))
        finally:
            lock = Path(f"{RunDirectory.find(os.environ).guard(os.fspath(robot.port))}.lock")
            os.kill(int(lock.read_text()), signal.SIGTERM)
            robot.close()
    return found


def run(rounds: int = ROUNDS) -> list[Row]:
    rows: list[Row] = []
    for name, times in _measured(rounds).items():
        times.sort()
        rows.append(
            {
                "name": f"last command to stop on the wire after {name}, worst of {len(times)}",
                "value": times[-1],
                "target": TARGET_MS,
                "unit": "ms",
                "ok": times[-1] <= TARGET_MS,
                "note": f"median {times[len(times) // 2]:.0f} ms; the driver sends every 50 ms",
            }
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    for row in run(parser.parse_args().rounds):
        print(f"{row['name']}: {row['value']:.1f} ms ({row['note']})")


if __name__ == "__main__":
    main()
