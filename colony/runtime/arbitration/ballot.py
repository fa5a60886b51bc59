"""The rule that gives an actuator to one of the parties that want it in a frame.

Three kinds of parties want it. The clients of the network bid by their places; by their exclusive guards at
most one of them commands. Connections from outside command by the priority of the connection, which is never
that of a place: one above the network's winner takes its place, one below acts only when the network is idle.
And the emergency stop or a lock keeps out all parties, or all but the holder.

The rule applies to the part of the frame that has come. What is not known is never taken for idleness. A
command from outside acts when every client with a higher place was heard and is silent, or when the network's
winner has a lower place (then, by the exclusive guards, every client above that winner is inactive); a higher
client that is late, lost or refused leaves idle.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable
from typing import NamedTuple, get_args

from colony.ir.frame import Bid
from colony.ir.types import ScalarValue
from colony.runtime.protocol.deployment import ActuatorTable, FieldTable
from colony.runtime.protocol.messages import Hold, Request


class Places:
    """The clients of an actuator, highest place first, and their priorities in descending order."""

    def __init__(self, clients: tuple[tuple[str, int], ...]) -> None:
        self.names = tuple(name for name, _ in clients)
        self.priorities = tuple(priority for _, priority in clients)
        self.rank = {name: rank for rank, name in enumerate(self.names)}

    def above(self, priority: int) -> int:
        """Return the number of clients with a higher priority."""
        return sum(p > priority for p in self.priorities)


class Outside(NamedTuple):
    """A command from outside the network; `values` in base units, in the order of the actuator's fields."""

    connection: str
    priority: int
    values: tuple[ScalarValue, ...]


class Others(NamedTuple):
    """The influences on a frame besides the network: outside commands and holds.

    `commands` are in descending order of priority, no two of one priority. `hold` keeps out all parties, or
    all but the `holder` of the lock.
    """

    commands: tuple[Outside, ...] = ()
    hold: Hold | None = None
    holder: str | None = None


NOBODY = Others()
STOPPED = Others(hold="stopped")


class Choice(NamedTuple):
    """The present decision of a frame: the client `by` or the connection `outside` acts, or neither (idle).

    `settled`: no client that could still be heard can change it.
    """

    by: str | None
    outside: Outside | None
    settled: bool


class Ballot:
    """The requests of one frame of one actuator. Mutable: those that came.

    No method takes longer for more clients; only creating the ballot does.
    """

    def __init__(self, places: Places, lost: Iterable[str]) -> None:
        count = len(places.names)
        self._places = places
        self.requests: dict[str, Request] = {}
        self.commands = 0
        self._heard = bytearray(count)
        self._first = 0  # the highest rank that is still to be heard
        self._gone = count  # the highest rank whose request will never be known
        self._contender = count  # the highest rank that commands
        for client in lost:
            self.without(client)

    @property
    def complete(self) -> bool:
        """True if no client is left to be heard."""
        return self._first == len(self._heard)

    def take(self, request: Request) -> None:
        """Take a client's first, well-formed request; that of a lost client does not count."""
        rank = self._places.rank[request.client]
        self.requests[request.client] = request
        if self._heard[rank]:
            return
        if request.bid == "command":
            self.commands += 1
            self._contender = min(self._contender, rank)
        self._pass(rank)

    def without(self, client: str) -> None:
        """Stop waiting for a client; its bid stays unknown."""
        rank = self._places.rank[client]
        self._gone = min(self._gone, rank)
        self._pass(rank)

    def late(self, client: str) -> None:
        """Note a request that came after the decision."""
        self._pass(self._places.rank[client])

    def choose(self, others: Others) -> Choice:
        """Return the decision, as far as it is known."""
        match others.hold:
            case "stopped":
                return Choice(None, None, True)
            case "locked":
                mine = (c for c in others.commands if c.connection == others.holder)
                return Choice(None, next(mine, None), True)
            case None:
                pass
        count = len(self._heard)
        if others.commands:
            outside = others.commands[0]
            above = self._places.above(outside.priority)
            if above <= self._contender:
                if min(self._first, self._gone) >= above:
                    return Choice(None, outside, True)
                if self._contender < count:
                    return Choice(None, outside, False)
        if self._contender < count:
            return Choice(self._places.names[self._contender], None, self._first > self._contender)
        return Choice(None, None, self.complete)

    def _pass(self, rank: int) -> None:
        heard = self._heard
        heard[rank] = 1
        if rank == self._first:
            first = heard.find(0, rank)
            self._first = len(heard) if first < 0 else first


_BIDS = frozenset(get_args(Bid))


def malformed(request: Request, actuator: ActuatorTable, places: Container[str]) -> str | None:
    """Return the reason why a request is malformed, or None. No malformed request may move a robot."""
    if request.client not in places:
        return f"`{request.client}` is no client of {actuator.name}"
    if request.bid not in _BIDS:
        return f"`{request.client}` bids {request.bid!r}"
    if request.bid != "command":
        return None
    if request.values is None:
        return None if request.fault else f"`{request.client}` commands without values"
    if len(request.values) != len(actuator.fields):
        return f"`{request.client}` gave {len(request.values)} values, not {len(actuator.fields)}"
    for field, value in zip(actuator.fields, request.values, strict=True):
        if not _acceptable(field, value):
            return f"`{request.client}` gave {field.name} = {value!r}"
    return None


def _acceptable(field: FieldTable, value: ScalarValue) -> bool:
    if field.kind == "bool":
        return isinstance(value, bool)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return False
    return (field.low is None or value >= field.low) and (field.high is None or value <= field.high)
