"""The restarts of a process: the first is immediate, the next ones follow increasing pauses, then they stop.

Only deaths in quick succession count: a process that lives for `STABLE_NS` starts over with a clean slate.
A process that somebody kills has not failed, and is restarted however often.
"""

from __future__ import annotations

from colony.backoff import Backoff

STABLE_NS = 5_000_000_000
"""Lifetime, in nanoseconds, after which a process counts as stable."""

UNHURRIED_NS = 1_000_000_000
"""Lifetime, in nanoseconds, below which a process that is killed twice waits before its restart."""

FIRST_PAUSE_NS = 250_000_000
"""Pause in nanoseconds before the second restart in a row; each further pause is twice as long."""

MAX_PAUSE_NS = 4_000_000_000
"""Maximum pause before a restart, in nanoseconds."""

MAX_QUICK_DEATHS = 6
"""Quick deaths in a row after which a process is not restarted."""


class Restarts:
    """The restarts of one process. Stateful: counts the quick deaths in a row.

    A process that does not give up is restarted after any number of them.
    """

    def __init__(self, *, gives_up: bool = True) -> None:
        self._gives_up = gives_up
        self._pauses = Backoff(FIRST_PAUSE_NS, MAX_PAUSE_NS)
        self.quick_deaths = 0
        self._killed_soon = False
        self.total = 0

    def next_start(self, began_ns: int, now_ns: int, *, killed: bool = False) -> int | None:
        """Record a death, by SIGKILL if `killed`; return the time of the restart, None if there is none."""
        if killed:
            self.total += 1
            hurried = now_ns - began_ns < UNHURRIED_NS
            pause = FIRST_PAUSE_NS if hurried and self._killed_soon else 0
            self._killed_soon = hurried
            return now_ns + pause
        self.quick_deaths = 1 if now_ns - began_ns >= STABLE_NS else self.quick_deaths + 1
        if self._gives_up and self.quick_deaths >= MAX_QUICK_DEATHS:
            return None
        self.total += 1
        if self.quick_deaths == 1:
            self._pauses.reset()
            return now_ns
        return now_ns + self._pauses.next()
