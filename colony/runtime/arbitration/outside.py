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
from typing import Generic, TypeVar

from colony.runtime.protocol.calls import CallId, RefusedError
from colony.runtime.protocol.connections import Caller

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
