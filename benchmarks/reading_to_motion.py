"""How long a base takes to answer its bumper: from the press to the complete command that answers it.

The base is emulated, on a pseudoterminal with the pace of its line; its servers and a program are processes
(`colony serve all`, `colony drive`). At a random time its bumper is pressed, or released. Measured is
the time until the last byte of the first command that answers has crossed the line. No driver can do better
than the line and the device, nor the runtime than a frame. So it is held against the time of the line both
ways, one period of the device's packets and two frames.

    python -m benchmarks.reading_to_motion --events 400
"""

from __future__ import annotations

import argparse
import random
import statistics
import time

from benchmarks.processes import Row, busy, row, scratch
from tests.drivers.served_base import CREATE2, Base, Served, pioneer_at, served
from tests.waiting import until

BASES = (CREATE2, pioneer_at(9600), pioneer_at(38_400))

FRAME_S = 0.05
"""Length of the frames of both robots."""

EVENTS = 400

LONGEST_PAUSE_S = 0.2
"""The longest pause between an answer and the next event: longer than any period here."""


def answers(base: Base, events: int) -> tuple[list[float], float]:
    """Return how many milliseconds each answer took, in order of size, and the bound."""
    rng = random.Random(1)
    with scratch() as folder, served(base, folder) as robot:
        robot.drive()
        robot.robot.longest = 0
        found = sorted(_answer_ms(robot, rng) for _ in range(events))
        wire_s = 10.0 * (robot.robot.longest + base.command_bytes) / base.baud
    return found, 1e3 * (wire_s + base.period_s + 2.0 * FRAME_S)


def _answer_ms(base: Served, rng: random.Random) -> float:
    """Press or release the bumper, and return how many milliseconds the answer takes."""
    time.sleep(rng.random() * LONGEST_PAUSE_S)
    robot, velocity = base.robot, base.base.velocity
    is_pressed = not robot.robot.touched
    sign = -1.0 if is_pressed else 1.0
    then = time.monotonic()
    robot.robot.touched = is_pressed
    answered = until(lambda: robot.first(then, lambda points: velocity(points) * sign > 0.0), "an answer")
    return 1e3 * (answered - then)


def run(events: int | None = None) -> list[Row]:
    rows = []
    for base in BASES:
        ms, bound_ms = answers(base, events or EVENTS)
        p50, p99 = statistics.median(ms), ms[int(0.99 * len(ms))]
        note = f"of {events or EVENTS} events; worst {ms[-1]:.0f} ms; {busy()}"
        rows.append(row(f"{base.title} baud: median", p50, "ms", None, f"{p50 / bound_ms:.2f} of the bound"))
        rows.append(row(f"{base.title} baud: 99th percentile", p99, "ms", bound_ms, note))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--events", type=int, default=EVENTS)
    for each in run(parser.parse_args().events):
        bound = "" if each["target"] is None else f"; at most {each['target']:.0f} ms"
        print(f"{each['name']}: {each['value']:.1f} ms{bound} ({each['note']})")


if __name__ == "__main__":
    main()
