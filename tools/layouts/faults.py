"""Faults of a run, alike in each layout: they depend on times and on what a message says, not on its order.

A node fails when it is woken at a time that was drawn, which no message of that time can precede or follow in
one layout only. The fate of a message is drawn from the seed, the receiver, the message, and how often the
receiver got it.
"""

from __future__ import annotations

import heapq
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import (
    Alive,
    Call,
    Effect,
    Malformed,
    Message,
    Node,
    Notice,
    Reply,
    SettlingNode,
    Wake,
    WakeAt,
)
from colony.runtime.transport.faults import FaultRates, LinkFaults

JOINING_NS = 1000
"""Nanoseconds for which a node that starts says nothing."""


SLACK_NS = 500
"""Nanoseconds by which nodes wake late, so that a deadline at the time of a tick passes after the tick."""


class Failure(NamedTuple):
    """A failure of the part `part` at `t_ns`, which starts again after `pause_ns`."""

    t_ns: int
    part: str
    pause_ns: int


class InjectedError(Exception):
    """A failure of a node that was drawn."""

    def __init__(self, failure: Failure) -> None:
        super().__init__(f"{failure.part} at {failure.t_ns}")
        self.failure = failure


class Guard:
    """The faults of one run in one layout, and the times at which its nodes want to be woken. Mutable.

    Args:
        seed: what the fates of messages are drawn from.
        rates: the rates of faults of messages; None for none.
        failures: the failures of parts.
    """

    def __init__(self, seed: int, rates: FaultRates | None, failures: Iterable[Failure]) -> None:
        self._seed = seed
        self._rates = rates
        self._failures = tuple(failures)
        self._met: Counter[tuple[str, bytes]] = Counter()
        self._wakes: list[int] = []

    def guarded(self, nodes: Iterable[Node], part: str) -> tuple[Node, ...]:
        """Return the nodes of a part, with the faults drawn for them."""
        failures = tuple(failure for failure in self._failures if failure.part == part)
        return tuple(
            (_GuardedSettling if isinstance(node, SettlingNode) else _Guarded)(
                node, self, failures * (i == 0)
            )
            for i, node in enumerate(nodes)
        )

    def wake_at(self, t_ns: int) -> None:
        """Note when a node wants to be woken."""
        heapq.heappush(self._wakes, t_ns)

    def next_wake(self, now_ns: int) -> int | None:
        """Return the next time after `now_ns` at which a node wants to be woken."""
        while self._wakes and self._wakes[0] <= now_ns:
            heapq.heappop(self._wakes)
        return self._wakes[0] if self._wakes else None

    def delays(self, receiver: str, message: Message) -> tuple[int, ...]:
        """Return the delays with which the copies of a message arrive."""
        if self._rates is None or isinstance(message, _EXEMPT):
            return _AT_ONCE
        identity = repr(message).encode()
        self._met[receiver, identity] += 1
        drawn = LinkFaults(
            zlib.crc32(
                identity, zlib.crc32(f"{self._seed}/{receiver}/{self._met[receiver, identity]}".encode())
            ),
            self._rates,
        )("", receiver, message)
        return () if drawn is None else drawn if isinstance(drawn, tuple) else (drawn,)


_AT_ONCE = (0,)
_EXEMPT = (Alive, Call, Malformed, Notice, Reply, Wake)


class _Guarded:
    """A node that may fail, and that messages may reach late, twice or never. Mutable."""

    def __init__(self, node: Node, guard: Guard, failures: tuple[Failure, ...]) -> None:
        self.address = node.address
        self.listens = node.listens
        self._node = node
        self._guard = guard
        self._failures = failures
        self._late: list[tuple[int, int, Message]] = []
        self._begun: tuple[Effect, ...] = ()

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Start the node, which speaks as soon as its process is linked, and wait for its failures."""
        self._failures = tuple(failure for failure in self._failures if failure.t_ns > now_ns)
        pending = (WakeAt(failure.t_ns) for failure in self._failures)
        self._begun, self._begun_ns = tuple(self._node.start(now_ns)), now_ns + JOINING_NS
        return self._noted((WakeAt(self._begun_ns), *pending))

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Let the node handle a message, unless it fails or the message is late or lost."""
        for failure in self._failures:
            if failure.t_ns <= now_ns:
                raise InjectedError(failure)
        return self._noted(tuple(self._handle(message, now_ns)))

    def _handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        if now_ns >= self._begun_ns:
            yield from self._begun
            self._begun = ()
        for delay_ns in self._guard.delays(self.address, message):
            if delay_ns == 0:
                yield from self._node.handle(message, now_ns)
            else:
                heapq.heappush(self._late, (now_ns + delay_ns, len(self._late), message))
                yield WakeAt(now_ns + delay_ns)
        while self._late and self._late[0][0] <= now_ns:
            yield from self._node.handle(heapq.heappop(self._late)[2], now_ns)

    def _noted(self, effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
        """Return the effects, with wakes after the tick of their time."""
        slack_ns = 0 if self.address == topics.CLOCK else SLACK_NS
        noted = tuple(WakeAt(e.t_ns + slack_ns) if isinstance(e, WakeAt) else e for e in effects)
        for effect in noted:
            if isinstance(effect, WakeAt):
                self._guard.wake_at(effect.t_ns)
        return noted

    def close(self) -> None:
        """Close the node."""
        self._node.close()


class _GuardedSettling(_Guarded):
    """A node that has to settle, with the same faults."""

    _node: Any

    @property
    def unsettled(self) -> bool:
        """True if `settle` has something to finish."""
        unsettled: bool = self._node.unsettled
        return unsettled

    def settle(self) -> Callable[[], None] | None:
        """Settle the node."""
        finish: Callable[[], None] | None = self._node.settle()
        return finish
