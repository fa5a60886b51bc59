"""Connections that command an actuator from outside the network: strict order, and leases that end.

A connection takes part in arbitration from its first command until it ends, and for that time its priority
is its own: nobody else may command with the same, be it another connection or a client of the network. What
it commands holds until its lease runs out, or until it is done.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from colony.runtime.arbitration.motion import Motion
from colony.runtime.protocol.calls import Asked, Refused
from colony.runtime.protocol.connections import Caller

LONGEST_LEASE_S = 60.0


@dataclass(frozen=False, slots=True, kw_only=True)
class Commander:
    """A connection, and what it commands: until when (None: until it is done), and who waits for the end."""

    caller: Caller
    motion: Motion | None = None
    until_ns: int | None = None
    asked: Asked | None = None


class Outsiders:
    """Mutable: who commands what."""

    def __init__(self) -> None:
        self._by_priority: dict[int, Commander] = {}

    @property
    def all(self) -> tuple[Commander, ...]:
        """Everyone who has commanded, highest priority first."""
        return tuple(self._by_priority[p] for p in sorted(self._by_priority, reverse=True))

    @property
    def commanding(self) -> tuple[Commander, ...]:
        """Those who want something now, highest priority first."""
        return tuple(c for c in self.all if c.motion is not None) if self._by_priority else ()

    def enter(self, caller: Caller, places: Mapping[int, str]) -> Commander:
        """The commander that a connection is; `places` are the clients of the network by priority.

        Raises:
            Refused: "tie": somebody else has that priority.
        """
        known = self._by_priority.get(caller.priority)
        if known is not None and known.caller.connection == caller.connection:
            return known
        holder = (
            f"`{places[caller.priority]}`, a client of the program," if caller.priority in places else None
        )
        if known is not None:
            holder = f"{known.caller.name} ({known.caller.connection})"
        if holder is not None:
            found = f"priority {caller.priority} is taken: {holder} commands with it"
            raise Refused("tie", f"{found}; open the connection with another")
        entered = self._by_priority[caller.priority] = Commander(caller=caller)
        return entered

    def of(self, caller: Caller) -> Commander | None:
        """The commander that a connection is, if it is one."""
        known = self._by_priority.get(caller.priority)
        return known if known is not None and known.caller.connection == caller.connection else None

    def leave(self, caller: Caller) -> None:
        """A connection ended: its priority is free."""
        if self.of(caller) is not None:
            del self._by_priority[caller.priority]

    def expire(self, now_ns: int) -> None:
        """End the commands whose lease has run out."""
        for commander in self._by_priority.values():
            if commander.until_ns is not None and now_ns >= commander.until_ns:
                commander.motion = commander.until_ns = None

    def tied(self, places: Mapping[int, str]) -> str | None:
        """What is wrong with a network of these clients by priority, or None."""
        for priority, client in places.items():
            if (known := self._by_priority.get(priority)) is not None:
                who = f"{known.caller.name} ({known.caller.connection})"
                return f"`{client}` has priority {priority}, with which {who} commands"
        return None


def lease_end(lease_s: float, now_ns: int) -> int:
    """When a lease that begins now ends.

    Raises:
        Refused: "arguments": it is not positive, or longer than anybody may hold a robot unheard.
    """
    if not (math.isfinite(lease_s) and 0.0 < lease_s <= LONGEST_LEASE_S):
        expected = f"expected more than 0 and at most {LONGEST_LEASE_S:g} s"
        raise Refused("arguments", f"a lease of {lease_s:g} s; {expected}")
    return now_ns + max(1, round(lease_s * 1e9))
