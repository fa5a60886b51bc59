"""The wakes that a node asks for: one at a time, in place of one for each change of what is due."""

from __future__ import annotations

from collections.abc import Iterable

from colony.runtime.protocol.messages import Effect, WakeAt


class WakeSchedule:
    """The next wake of a node or of one of its parts. Mutable."""

    def __init__(self) -> None:
        self._next_ns: int | None = None

    def request(self, due_ns: int | None, now_ns: int) -> Iterable[Effect]:
        """Ask for a wake at `due_ns`, unless one is to come by then; None asks for nothing."""
        next_ns = self._next_ns
        if due_ns is None or due_ns == next_ns or (next_ns is not None and now_ns < next_ns < due_ns):
            return ()
        self._next_ns = due_ns
        return (WakeAt(due_ns),)
