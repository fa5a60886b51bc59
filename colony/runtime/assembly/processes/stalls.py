"""A thread that notices when its process stands still: frozen, starved, or held by code that never yields.

Python runs one thread at a time. Code that keeps the interpreter for itself, such as a driver in C, stops all
servers of a process, also their emergency stops; a base then stands by its own watchdog or guard, because
commands no longer arrive. Afterwards this thread says for how long it was.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager

from colony.runtime.observe.repeating import repeating

INTERVAL_S = 0.1
"""Seconds between two looks."""

STALL_S = 0.25
"""Seconds of delay that are reported, several frames of most robots."""


def reporting_stalls(report: Callable[[str], None]) -> AbstractContextManager[None]:
    """Return a context in which stalls of this process are reported."""
    last = time.monotonic()

    def look() -> None:
        nonlocal last
        now = time.monotonic()
        if (text := stall(now - last)) is not None:
            report(text)
        last = now

    return repeating("stalls", look, interval_s=INTERVAL_S)


def stall(waited_s: float) -> str | None:
    """Return what to report after a wait of `INTERVAL_S` that took so long; None if it was on time."""
    late_s = waited_s - INTERVAL_S
    if late_s < STALL_S:
        return None
    return (
        f"this process stood still for {late_s:.2f} s: it was frozen, the machine is overloaded, or a driver "
        "holds the interpreter"
    )
