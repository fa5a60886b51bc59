"""The restarts of a process: immediate, then after increasing pauses, and finally none.

Only deaths in quick succession count: a process that was alive for `STABLE_NS` starts with a clean slate.
"""

from __future__ import annotations

STABLE_NS = 5_000_000_000
"""Lifetime, in nanoseconds, after which a process counts as stable."""

FIRST_PAUSE_NS = 250_000_000
"""Nanoseconds before the second restart in a row; each further pause doubles."""

MAX_PAUSE_NS = 4_000_000_000
"""Longest pause before a restart, in nanoseconds."""

MAX_QUICK_DEATHS = 6
"""Quick deaths in a row after which a process is not restarted."""


class Restarts:
    """The restarts of one process. Mutable: the number of quick deaths in a row."""

    def __init__(self) -> None:
        self.quick = 0
        self.total = 0

    def died(self, began_ns: int, now_ns: int) -> int | None:
        """Return the time of the restart; None if there is none."""
        self.quick = 1 if now_ns - began_ns >= STABLE_NS else self.quick + 1
        if self.quick >= MAX_QUICK_DEATHS:
            return None
        self.total += 1
        pause = 0 if self.quick == 1 else min(FIRST_PAUSE_NS << (self.quick - 2), MAX_PAUSE_NS)
        return now_ns + pause
