"""A thread that notices when its process stands still: frozen, starved, or held by code that never yields.

Python runs one thread at a time. Code that keeps the interpreter for itself, such as a driver in C, stops all
servers of a process, also their emergency stops; a base then stands by its own watchdog or guard, because
commands no longer arrive. Afterwards this thread says for how long it was.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread

INTERVAL_S = 0.1
"""Seconds between two looks."""

STALL_S = 0.25
"""Seconds of delay that are reported, several frames of most robots."""


@contextmanager
def reporting_stalls(
    report: Callable[[str], None], clock: Callable[[], float] = time.monotonic
) -> Iterator[None]:
    """Report stalls of this process inside the `with`."""
    ended = Event()

    def look() -> None:
        last = clock()
        while not ended.wait(INTERVAL_S):
            now = clock()
            if (text := stall(now - last)) is not None:
                report(text)
            last = now

    thread = Thread(target=look, name="stalls", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def stall(waited_s: float) -> str | None:
    """Return what to report after a wait of `INTERVAL_S` that took so long; None if it was on time."""
    late_s = waited_s - INTERVAL_S
    if late_s < STALL_S:
        return None
    return (
        f"this process stood still for {late_s:.2f} s: it was frozen, the machine is overloaded, or a driver "
        "holds the interpreter"
    )
