"""A lock of a server: one token, and who waits for it (thesis section 4.6.3, "Locking Mechanism").

RServer's lock gives one client exclusive motion, a CServer's keeps its image from being replaced. Requests
that wait are served by the priority of their connections, first come first served within one. Each waits for
as long as it asked to and no longer, so that nobody is given a lock after it stopped waiting. The death of a
holder, or of one who waits, is a matter of `drop`.
"""

from __future__ import annotations

from typing import NamedTuple

from colony.runtime.protocol.calls import Asked, Refused
from colony.runtime.protocol.connections import Caller


class _Waiting(NamedTuple):
    order: tuple[int, int]
    until_ns: int
    asked: Asked


class LockQueue:
    """Mutable: who holds the token, and who waits.

    What was granted or refused late is returned as the calls to answer.
    """

    def __init__(self) -> None:
        self._holder: Caller | None = None
        self._waiting: list[_Waiting] = []
        self._count = 0

    @property
    def holder(self) -> Caller | None:
        """Who has the token."""
        return self._holder

    @property
    def waiting(self) -> tuple[Caller, ...]:
        """Who waits for it, in the order in which they will be served."""
        return tuple(w.asked.caller for w in sorted(self._waiting))

    @property
    def wake_at(self) -> int | None:
        """When the patience of somebody who waits ends."""
        return min((w.until_ns for w in self._waiting), default=None)

    def ask(self, asked: Asked, now_ns: int, *, wait_ns: int) -> bool:
        """Whether the token is granted now; it is, again, to who has it. Otherwise the call waits for it.

        Raises:
            Refused: "locked": somebody else has it, and the call does not wait.
        """
        if self._holder is None or self._holder.connection == asked.caller.connection:
            self._holder = asked.caller
            return True
        if wait_ns <= 0:
            raise self.refusal()
        self._count += 1
        self._waiting.append(_Waiting((-asked.caller.priority, self._count), now_ns + wait_ns, asked))
        return False

    def release(self, caller: Caller) -> tuple[Asked, ...]:
        """Take the token back from who has it; gives the calls that are granted by that.

        Raises:
            Refused: "unlocked": the caller does not have it.
        """
        if self._holder is None or self._holder.connection != caller.connection:
            raise Refused("unlocked", f"{caller.name} does not hold the lock")
        self._holder = None
        return self._grant()

    def drop(self, caller: Caller) -> tuple[Asked, ...]:
        """A connection ended: it neither has the token nor waits for it; gives the calls that are granted."""
        self._waiting = [w for w in self._waiting if w.asked.caller.connection != caller.connection]
        if self._holder is None or self._holder.connection != caller.connection:
            return ()
        self._holder = None
        return self._grant()

    def expire(self, now_ns: int) -> tuple[Asked, ...]:
        """The calls that have waited for as long as they would; they are to be refused."""
        late = tuple(w.asked for w in sorted(self._waiting) if now_ns >= w.until_ns)
        self._waiting = [w for w in self._waiting if now_ns < w.until_ns]
        return late

    def refusal(self) -> Refused:
        """Why a call does not get the token."""
        name = "nobody" if self._holder is None else self._holder.name
        return Refused("locked", f"{name} holds the lock")

    def _grant(self) -> tuple[Asked, ...]:
        """Give the token to the first who waits, with all of its calls that wait."""
        if not self._waiting:
            return ()
        self._holder = min(self._waiting).asked.caller
        connection = self._holder.connection
        granted = tuple(w.asked for w in sorted(self._waiting) if w.asked.caller.connection == connection)
        self._waiting = [w for w in self._waiting if w.asked.caller.connection != connection]
        return granted
