"""The restarts of a process: at once, then after increasing pauses, and finally not at all.

Only deaths in quick succession count; a process that lived for a while starts with a clean slate.
"""

from __future__ import annotations

STEADY_NS = 5_000_000_000
"""Lifetime in nanoseconds after which a process counts as started well."""

PAUSE_NS = 250_000_000
"""Nanoseconds before the second restart in a row; each further pause doubles."""

LONGEST_NS = 4_000_000_000

QUICK_DEATHS = 6
"""Quick deaths in a row after which a process is given up."""


class Restarts:
    """The restarts of one process. Mutable: the number of quick deaths in a row."""

    def __init__(self) -> None:
        self.quick = 0
        self.total = 0

    def died(self, began_ns: int, now_ns: int) -> int | None:
        """Return the time of the restart; None if the process is given up."""
        self.quick = 1 if now_ns - began_ns >= STEADY_NS else self.quick + 1
        if self.quick >= QUICK_DEATHS:
            return None
        self.total += 1
        pause = 0 if self.quick == 1 else min(PAUSE_NS << (self.quick - 2), LONGEST_NS)
        return now_ns + pause
