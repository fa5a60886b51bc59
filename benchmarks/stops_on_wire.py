"""How soon the stop is on the wire when a process that has to do with driving dies or stands still.

Emulated bases stand on pseudoterminals with the pace of their lines; servers, a program that drives ahead,
and the guard are processes as on a real robot. One of them is killed, or frozen as by a debugger, at a random
time in its frame, or the cable is pulled. Measured is the time from then until the base has heard a speed of
0. Where the cable is out, nothing can arrive: then it is the time until the watchdog of the base holds it,
and a base without one goes on. In the case of nothing at all it drives on as well, unless the machine is so
busy that frames are late, which are idle.

Then a user stops the robot, again and again, alone and beside a program on the robot's own machine that calls
its base 10,000 times a second: until the base has heard a speed of 0.

    python -m benchmarks.stops_on_wire --rounds 20
"""

from __future__ import annotations

import argparse
import math
import os
import random
import signal
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from dataclasses import dataclass

from benchmarks.processes import Row, busy, row, scratch
from colony.runtime.assembly.processes.spec import address_spec
from colony.runtime.kit.emergency import StopButton
from colony.runtime.transport.live.network import local_user
from tests.cli.machine import release
from tests.drivers.served_base import CREATE2, Base, Served, pioneer_at, served
from tools.attack.flood import LOCAL_RATE, Order, poured

BASES = (CREATE2, pioneer_at(9600))

ROUNDS = 5

WATCHED_S = 4.0
"""Seconds for which a base is watched that nothing has to stop."""

POLL_S = 0.01
"""Seconds between two looks whether it has stopped."""

PATIENCE_S = 20.0
"""Seconds after which a base counts as one that does not stop."""

PRESSES = 200
"""Presses of the stop button, alone and beside a flood."""

MOST_MS = {"50 %": 5.0, "99 %": 20.0}
"""The most milliseconds that a pressed stop may take to the wire."""

AGAIN_MOST_MS = 1500.0
"""The most milliseconds from the end of a process with the servers to the next command of the program."""


@dataclass(frozen=True, slots=True)
class Case:
    """What happens: a name, what does it, what undoes it, and the most that the stop may take in ms.

    `is_cut_off` means that no byte can reach the base any more, so that its watchdog has to stop it;
    otherwise None as `most_ms` means that the base has to drive on.
    """

    name: str
    strike: Callable[[Served], object]
    undo: Callable[[Served], object]
    most_ms: float | None
    is_cut_off: bool = False


def _case(name: str, pid: Callable[[Served], int], number: signal.Signals, most_ms: float | None) -> Case:
    struck: list[int] = []

    def strike(base: Served) -> None:
        struck[:] = [pid(base)]
        os.kill(struck[0], number)

    def undo(base: Served) -> None:
        with suppress(ProcessLookupError):  # a frozen guard was killed
            os.kill(struck[0], signal.SIGCONT)

    return Case(f"{number.name} of {name}", strike, undo, most_ms)


def _leader(base: Served) -> int:
    assert base.leader is not None
    return base.leader.pid


def _pull_out(base: Served) -> None:
    base.emulator.pull_out()


def _cases() -> Iterator[Case]:
    for number in (signal.SIGKILL, signal.SIGSTOP):
        yield _case("RServer", lambda base: base.pid("RServer"), number, 250.0)
        yield _case("the Clock", lambda base: base.pid("Clock"), number, 250.0)
        yield _case("the leader of the program", _leader, number, 600.0)
        most_ms = 1000.0 if number == signal.SIGKILL else 2500.0
        yield _case("the guard", lambda base: base.guard, number, most_ms)
    yield _case("the supervisor of `serve all`", lambda base: base.supervisor.pid, signal.SIGSTOP, None)
    yield Case("nothing at all", lambda base: None, lambda base: None, None)
    yield Case("a pulled cable", _pull_out, lambda base: base.emulator.plug_in(), None, is_cut_off=True)


def _stopped_after_ms(base: Served, case: Case, rng: random.Random, again: list[float]) -> float | None:
    """Drive, let a case happen, and return the milliseconds until the base is stopped; None if it is not.

    `again` gets the milliseconds until it drives again, after RServer was killed.
    """
    base.drive()
    time.sleep(rng.random() * 0.05)
    then = time.monotonic()
    case.strike(base)

    def stopped() -> float | None:
        if case.is_cut_off and base.base.stops_itself(base.robot.robot):
            return time.monotonic()
        return base.robot.stood(then)

    end = then + (PATIENCE_S if _has_to_stop(base.base, case) else WATCHED_S)
    try:
        while (found := stopped()) is None and time.monotonic() < end:
            time.sleep(POLL_S)
        if found is not None and case.name == f"{signal.SIGKILL.name} of RServer":
            again.append(1e3 * (_drives_again(base, found) - then))
        return None if found is None else 1e3 * (found - then)
    finally:
        case.undo(base)
        if "leader" in case.name:
            base.end_program()


def _has_to_stop(base: Base, case: Case) -> bool:
    return base.watchdog_s is not None if case.is_cut_off else case.most_ms is not None


def _drives_again(base: Served, since: float) -> float:
    """Wait until it is told to move ahead, after it was stopped at a time, and return when."""
    while (found := base.robot.first(since, lambda points: base.base.velocity(points) > 0.0)) is None:
        time.sleep(POLL_S)
        if time.monotonic() > since + PATIENCE_S:
            return math.inf
    return found


def _pressed_ms(base: Served, rng: random.Random) -> Iterator[float]:
    """Stop it again and again, and yield the milliseconds until it has heard it."""
    with base.session() as session, StopButton(session) as button:
        for _ in range(PRESSES):
            base.drive()
            time.sleep(rng.random() * 0.05)
            then = time.monotonic()
            button.press()
            while (found := base.robot.stood(then)) is None and time.monotonic() < then + PATIENCE_S:
                time.sleep(POLL_S)
            yield 1e3 * (found - then) if found is not None else math.inf
            release(session)


def _pressed_rows(base: Served, rng: random.Random) -> Iterator[Row]:
    order = Order(
        kind="read calls",
        robot_address=address_spec(base.robot_address),
        user=local_user(),
        seconds=600.0,
        most=sys.maxsize,
        rate=LOCAL_RATE,
    )
    for name, flooded in (("a stop", False), (f"a stop beside {LOCAL_RATE:,.0f} calls a second", True)):
        base.drive()
        with poured(order) if flooded else nullcontext():
            took = sorted(_pressed_ms(base, rng))
        for share, at in (("50 %", 0.5), ("99 %", 0.99)):
            title = f"{base.base.title}: {name}, {share} of {len(took)}"
            most_ms = MOST_MS[share] + 1e3 * base.base.command_bytes * 10 / base.base.baud
            yield row(title, took[int(at * (len(took) - 1))], "ms", most_ms, busy())


def _rows_of(base: Base, rounds: int) -> Iterator[Row]:
    rng = random.Random(1)
    cases = tuple(_cases())
    found: dict[str, list[float | None]] = {case.name: [] for case in cases}
    again: list[float] = []
    with scratch() as folder, served(base, folder) as robot:
        for _ in range(rounds):
            for case in cases:
                ms = _stopped_after_ms(robot, case, rng, again)
                found[case.name].append(ms)
                text = "drove on" if ms is None else f"stopped after {ms:.0f} ms"
                print(f"{base.title}: {case.name}: {text}", file=sys.stderr)
        pressed = [*_pressed_rows(robot, rng)]
    for case in cases:
        yield _row(base, case, found[case.name])
    note = f"median {statistics.median(again):.0f} ms; {busy()}"
    title = f"{base.title}: SIGKILL of RServer, drives again, worst of {len(again)}"
    yield row(title, max(again), "ms", AGAIN_MOST_MS, note)
    yield from pressed


def _row(base: Base, case: Case, found: list[float | None]) -> Row:
    has_to_stop = _has_to_stop(base, case)
    times = sorted(math.inf if ms is None else ms for ms in found if has_to_stop or ms is not None)
    name = f"{base.title}: {case.name}, worst of {len(found)}"
    if times:
        most_ms = case.most_ms
        if case.is_cut_off and base.watchdog_s is not None:
            most_ms = 1e3 * (base.watchdog_s + base.period_s)
        note = f"median {times[len(times) // 2]:.0f} ms; {busy()}"
        value = times[-1] if most_ms is not None else float(len(times))
        return row(name, value, "ms" if most_ms is not None else "stops", most_ms or 0.0, note)
    why = "it has no watchdog" if case.is_cut_off else "as it has to"
    return row(name, 0.0, "stops", None if case.is_cut_off else 0.0, f"drove on for {WATCHED_S:g} s: {why}")


def run(rounds: int | None = None) -> list[Row]:
    return [each for base in BASES for each in _rows_of(base, rounds or ROUNDS)]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    for each in run(parser.parse_args().rounds):
        print(f"{each['name']}: {each['value']:.0f} {each['unit']} ({each['note']})")


if __name__ == "__main__":
    main()
