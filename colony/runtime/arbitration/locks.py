"""The lock of a server: one token, and the queue for it (thesis section 4.6.3, "Locking Mechanism").

RServer's lock gives one connection exclusive use of the base; a CServer's keeps its image from being
replaced. Waiting calls are served by the priority of their connections, then in the order of their arrival.
None waits longer than its timeout, so that no client gets a lock that it no longer expects. `drop` handles
the end of a connection that holds the lock or waits for it.
"""

from __future__ import annotations

from typing import NamedTuple

from colony.runtime.protocol.calls import CallId, RefusedError
from colony.runtime.protocol.connections import Caller


class _QueuedCall(NamedTuple):
    order: tuple[int, int]
    deadline_ns: int
    call_id: CallId


class LockQueue:
    """The holder of a token, and the calls that wait for it. Mutable.

    Methods return the calls to answer now: those that get the token, or whose timeout has passed.
    """

    def __init__(self) -> None:
        self._holder: Caller | None = None
        self._waiting: list[_QueuedCall] = []
        self._count = 0

    @property
    def holder(self) -> Caller | None:
        """The connection that holds the token."""
        return self._holder

    @property
    def queue(self) -> tuple[Caller, ...]:
        """Callers that wait for the token, in the order in which they will be served."""
        return tuple(w.call_id.caller for w in sorted(self._waiting))

    @property
    def wake_at(self) -> int | None:
        """The earliest timeout of the waiting calls."""
        return min(w.deadline_ns for w in self._waiting) if self._waiting else None

    def acquire(self, call_id: CallId, now_ns: int, *, wait_ns: int) -> bool:
        """Return True if the call gets the token now; otherwise queue the call. The lock is reentrant.

        Raises:
            RefusedError: "locked": another connection holds the token, and the call does not wait.
        """
        if self._holder is None or self._holder.connection == call_id.caller.connection:
            self._holder = call_id.caller
            return True
        if wait_ns <= 0:
            raise self.refusal()
        self._count += 1
        self._waiting.append(_QueuedCall((-call_id.caller.priority, self._count), now_ns + wait_ns, call_id))
        return False

    def release(self, caller: Caller) -> tuple[CallId, ...]:
        """Take the token back from its holder, and return the calls that get it now.

        Raises:
            RefusedError: "unlocked": the caller does not hold the lock.
        """
        if self._holder is None or self._holder.connection != caller.connection:
            raise RefusedError("unlocked", f"{caller.name} does not hold the lock")
        self._holder = None
        return self._grant()

    def drop(self, caller: Caller) -> tuple[CallId, ...]:
        """Remove a connection that ended; return the calls that get the token now."""
        self._waiting = [w for w in self._waiting if w.call_id.caller.connection != caller.connection]
        if self._holder is None or self._holder.connection != caller.connection:
            return ()
        self._holder = None
        return self._grant()

    def expire(self, now_ns: int) -> tuple[CallId, ...]:
        """Remove and return the calls whose timeout has passed; the caller refuses them."""
        expired = tuple(w.call_id for w in sorted(self._waiting) if now_ns >= w.deadline_ns)
        self._waiting = [w for w in self._waiting if now_ns < w.deadline_ns]
        return expired

    def refusal(self) -> RefusedError:
        """Return the refusal of a call that does not get the token."""
        name = "nobody" if self._holder is None else self._holder.name
        return RefusedError("locked", f"{name} holds the lock")

    def _grant(self) -> tuple[CallId, ...]:
        """Give the token to the first connection in the queue, and return all of its waiting calls."""
        if not self._waiting:
            return ()
        self._holder = min(self._waiting).call_id.caller
        connection = self._holder.connection
        granted = tuple(w.call_id for w in sorted(self._waiting) if w.call_id.caller.connection == connection)
        self._waiting = [w for w in self._waiting if w.call_id.caller.connection != connection]
        return granted
