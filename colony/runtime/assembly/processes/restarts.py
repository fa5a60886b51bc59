"""When a process that died is started again: at once, then after longer and longer pauses, and not for ever.

A process that lived for a while starts with a clean slate: only deaths in quick succession count.
"""

from __future__ import annotations

STEADY_NS = 5_000_000_000
"""A process that lived for so long had begun well."""

PAUSE_NS = 250_000_000
"""Before the second start in a row; it doubles from there."""

LONGEST_NS = 4_000_000_000

QUICK_DEATHS = 6
"""So many in a row, and it is given up."""


class Restarts:
    """Of one process. Mutable: how many quick deaths there were in a row."""

    def __init__(self) -> None:
        self.quick = 0
        self.total = 0

    def died(self, began_ns: int, now_ns: int) -> int | None:
        """The time at which to start it again; None when it is given up."""
        self.quick = 1 if now_ns - began_ns >= STEADY_NS else self.quick + 1
        if self.quick >= QUICK_DEATHS:
            return None
        self.total += 1
        pause = 0 if self.quick == 1 else min(PAUSE_NS << (self.quick - 2), LONGEST_NS)
        return now_ns + pause
