"""Connections that command an actuator from outside the network, with unique priorities and leases.

A connection takes part in arbitration from its first command until it ends. For that time its priority is
reserved: no other connection, and no client of the network, may command with it. Its command holds until the
command's lease expires, or until the motion is done.

What is commanded is the server's: RServer's connections command motions (`motion.py`), those of other servers
values of a command.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

from colony.runtime.protocol.calls import CallId, RefusedError
from colony.runtime.protocol.connections import Caller

# --- locks ---------------------------------------------------------------------------------------------
#
# The lock of a server: one token, and the queue for it (thesis section 4.6.3, "Locking Mechanism").
#
# RServer's lock gives one connection exclusive use of the base; a CServer's keeps its image from being
# replaced. Waiting calls are served by the priority of their connections, then in the order of their
# arrival. None waits longer than its timeout, so that no client gets a lock that it no longer expects.
# `drop` handles the end of a connection that holds the lock or waits for it.


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


# --- outside -------------------------------------------------------------------------------------------


MAX_LEASE_S = 60.0
"""Longest lease of a command, in seconds."""


C = TypeVar("C")


@dataclass(frozen=False, slots=True, kw_only=True)
class Commander(Generic[C]):
    """A connection and its command, None if it commands nothing now.

    `lease_end_ns` is the end of the command's lease (None: no lease; it holds until the motion is done).
    `call_id` is the call that is answered when the command ends. `unlimited` is True if the program's limits
    do not hold for its commands; `held_at_rest` if they kept the last one from moving the base toward the end
    of its motion. `held_since_ns` is the time since which they have kept its motion from making progress,
    None if they do not. `fault` is the reason why the idle command was sent in the place of the last one,
    None if it was not.
    """

    caller: Caller
    command: C | None = None
    lease_end_ns: int | None = None
    call_id: CallId | None = None
    unlimited: bool = False
    held_at_rest: bool = False
    held_since_ns: int | None = None
    fault: str | None = None

    def end(self) -> None:
        """End the command."""
        self.command = self.call_id = self.lease_end_ns = self.held_since_ns = None


class OutsideCommanders(Generic[C]):
    """The connections that command from outside, by priority. Mutable."""

    def __init__(self) -> None:
        self._by_priority: dict[int, Commander[C]] = {}

    @property
    def all(self) -> tuple[Commander[C], ...]:
        """All connections that take part, highest priority first."""
        return tuple(self._by_priority[p] for p in sorted(self._by_priority, reverse=True))

    @property
    def commanding(self) -> tuple[Commander[C], ...]:
        """The connections that command now, highest priority first."""
        return tuple(c for c in self.all if c.command is not None) if self._by_priority else ()

    def enter(self, caller: Caller, clients_by_priority: Mapping[int, str]) -> Commander[C]:
        """Return the commander of a connection, after adding it if it is new.

        Args:
            caller: connection that commands.
            clients_by_priority: clients of the network by priority.

        Raises:
            RefusedError: "tie": another connection or client has that priority.
        """
        occupant = self._by_priority.get(caller.priority)
        if occupant is not None and occupant.caller.connection == caller.connection:
            return occupant
        holder = (
            f"`{clients_by_priority[caller.priority]}`, a client of the program,"
            if caller.priority in clients_by_priority
            else None
        )
        if occupant is not None:
            holder = f"{occupant.caller.name} ({occupant.caller.connection})"
        if holder is not None:
            found = f"priority {caller.priority} is taken: {holder} commands with it"
            raise RefusedError("tie", f"{found}; open the connection with another")
        entered = self._by_priority[caller.priority] = Commander(caller=caller)
        return entered

    def find(self, caller: Caller) -> Commander[C] | None:
        """Return the commander of a connection, or None."""
        occupant = self._by_priority.get(caller.priority)
        if occupant is None or occupant.caller.connection != caller.connection:
            return None
        return occupant

    def leave(self, caller: Caller) -> None:
        """Free the priority of a connection that ended."""
        if self.find(caller) is not None:
            del self._by_priority[caller.priority]

    def expire(self, now_ns: int) -> None:
        """End the commands whose lease has expired."""
        for commander in self._by_priority.values():
            if commander.lease_end_ns is not None and now_ns >= commander.lease_end_ns:
                commander.command = commander.lease_end_ns = None

    def find_tie(self, clients_by_priority: Mapping[int, str]) -> str | None:
        """Return the conflict between the priorities of a network and those of connections, or None."""
        for priority, client in clients_by_priority.items():
            if (occupant := self._by_priority.get(priority)) is not None:
                holder = f"{occupant.caller.name} ({occupant.caller.connection})"
                return f"`{client}` has priority {priority}, with which {holder} commands"
        return None


def lease_end(lease_s: float, now_ns: int) -> int:
    """Return the end of a lease that begins now, in nanoseconds.

    Raises:
        RefusedError: "arguments": the lease is not positive, or longer than `MAX_LEASE_S`.
    """
    if not (math.isfinite(lease_s) and 0.0 < lease_s <= MAX_LEASE_S):
        expected = f"expected more than 0 and at most {MAX_LEASE_S:g} s"
        raise RefusedError("arguments", f"a lease of {lease_s:g} s; {expected}")
    return now_ns + max(1, round(lease_s * 1e9))
