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


QUIET_S = 30.0
"""Seconds after a report in which only a stall is reported that is longer."""


def reporting_stalls(report: Callable[[str], None]) -> AbstractContextManager[None]:
    """Return a context in which stalls of this process are reported, those of a busy machine now and then."""
    stalls, last = Stalls(), time.monotonic()

    def look() -> None:
        nonlocal last
        now = time.monotonic()
        if (text := stalls.after(now - last, now)) is not None:
            report(text)
        last = now

    return repeating("stalls", look, interval_s=INTERVAL_S)


class Stalls:
    """The stalls of a process. Stateful: remembers the one that was reported last."""

    def __init__(self) -> None:
        self._reported_s, self._quiet_until_s = 0.0, 0.0

    def after(self, waited_s: float, now_s: float) -> str | None:
        """Return what to report after a wait of `INTERVAL_S` that took so long; None if nothing is."""
        late_s = waited_s - INTERVAL_S
        if now_s >= self._quiet_until_s:
            self._reported_s = 0.0
        if late_s < max(STALL_S, self._reported_s):
            return None
        self._reported_s, self._quiet_until_s = late_s, now_s + QUIET_S
        return (
            f"this process stood still for {late_s:.2f} s: it was frozen, the machine is overloaded, or a "
            "driver holds the interpreter"
        )
