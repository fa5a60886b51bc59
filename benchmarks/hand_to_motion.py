"""How long a base takes to follow an operator's hand: from the event of a gamepad to the command on its line.

The base is an emulated Create 2 on a line as fast as its baud rate, which a program drives (`colony drive`);
`colony teleop` is a process as well. At a random time the stick is moved, or the deadman is let go. Nothing
can be faster than the frame that is to come, and the line.

    python -m benchmarks.hand_to_motion
"""

from __future__ import annotations

import random
import statistics
import time
from collections.abc import Callable

from benchmarks.processes import Row, busy, row, scratch
from benchmarks.reading_to_motion import FRAME_S, LONGEST_PAUSE_S
from tests.cli.machine import failed
from tests.drivers.served_base import CREATE2, Served, served
from tests.kit.gamepad import pad
from tests.waiting import until

EVENTS = 200
MARGIN_MS = 5.0


def _answer_ms(robot: Served, rng: random.Random, act: Callable[[], None], sign: float) -> float:
    """Act, and return how many milliseconds the first command in the direction takes."""
    time.sleep(rng.random() * LONGEST_PAUSE_S)
    then = time.monotonic()
    act()
    answered = until(
        lambda: robot.robot.first(then, lambda points: CREATE2.velocity(points) * sign > 0.0), "an answer"
    )
    return 1e3 * (answered - then)


def run() -> list[Row]:
    rng, moved, let_go = random.Random(1), [], []
    with scratch() as folder, served(CREATE2, folder) as robot, pad(folder) as stick:
        robot.drive()
        teleop = robot.start("teleop", "--robot", CREATE2.robot, "--gamepad", str(stick.path))
        until(lambda: failed(teleop) or teleop.out, "the gamepad is read")
        for _ in range(EVENTS):
            stick.move(y=-1.0)
            stick.press("tl")
            moved.append(_answer_ms(robot, rng, lambda: stick.move(y=1.0), -1.0))
            let_go.append(_answer_ms(robot, rng, lambda: stick.release("tl"), 1.0))
    rows = []
    for name, ms in (("a stick that moves", moved), ("a deadman that is let go", let_go)):
        ms.sort()
        note = f"of {EVENTS} events; 99 of 100 within {ms[int(0.99 * len(ms))]:.0f} ms, worst {ms[-1]:.0f} ms"
        p50 = statistics.median(ms)
        rows.append(row(f"{name}: median", p50, "ms", 1e3 * FRAME_S + MARGIN_MS, f"{note}; {busy()}"))
    return rows


if __name__ == "__main__":
    for each in run():
        print(f"{each['name']}: {each['value']:.1f} ms; at most {each['target']:.0f} ms ({each['note']})")
