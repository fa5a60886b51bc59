"""A transport within one process and in virtual time, with a seeded scheduler.

The very same nodes that a network joins are joined here by a queue. Messages due at the same moment are
delivered in an order drawn from the seed, so that a run never shows just one of the orders that a network
could bring about, and yet can be repeated. A `Link` delays and drops messages where a test wants faults.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Iterable
from typing import NamedTuple

from colony.runtime.messages import Effect, Message, Node, Send, Wake


class VirtualClock:
    """The present of a virtual run, in nanoseconds. Mutable: only its transport moves it."""

    def __init__(self, now_ns: int = 0) -> None:
        self.now_ns = now_ns

    def __call__(self) -> int:
        return self.now_ns


Link = Callable[[str, str, Message], int | None]
"""From sender to receiver (addresses): by how many nanoseconds a message is late, or None: it is lost."""


def perfect(sender: str, receiver: str, message: Message) -> int | None:
    """Every message arrives, at once."""
    return 0


class _Delivery(NamedTuple):
    t_ns: int
    order: float
    number: int
    receiver: str
    message: Message


class VirtualTransport:
    """Delivers what nodes send to those that listen. Mutable: the queue, and who lives."""

    def __init__(self, clock: VirtualClock, *, seed: int, link: Link = perfect) -> None:
        self._clock = clock
        self._link = link
        self._random = random.Random(seed).random
        self._nodes: dict[str, Node] = {}
        self._listeners: dict[str, list[str]] = {}
        self._queue: list[_Delivery] = []
        self._count = 0

    def add(self, node: Node) -> None:
        """Start a node. One of the same address takes the place of one that was killed."""
        address = node.address
        if address in self._nodes:
            raise ValueError(f"there are two nodes with the address {address}")
        self._nodes[address] = node
        for topic in node.listens:
            self._listeners.setdefault(topic, []).append(address)
        self._put(address, node.start(self._clock.now_ns))

    def kill(self, address: str) -> Node:
        """Take a node away without a word, as a crash would; what was on its way to it is lost."""
        node = self._nodes.pop(address)
        for topic in node.listens:
            self._listeners[topic].remove(address)
        self._queue = [d for d in self._queue if d.receiver != address]
        heapq.heapify(self._queue)
        return node

    def run_until(
        self,
        t_ns: int,
        *,
        stop: Callable[[], bool] = lambda: False,
        pace: Callable[[int], None] | None = None,
    ) -> bool:
        """Deliver everything that is due before `t_ns`, which is then the present.

        `pace` is called with each new present before anything happens in it (a run at wall-clock speed
        sleeps there). Returns False when `stop` said so: only between moments, never in the middle of one.
        """
        queue, clock = self._queue, self._clock
        while queue and queue[0].t_ns < t_ns:
            due = queue[0].t_ns
            if due > clock.now_ns:
                if stop():
                    return False
                if pace is not None:
                    pace(due)
                clock.now_ns = due
            delivery = heapq.heappop(queue)
            node = self._nodes.get(delivery.receiver)
            if node is not None:
                self._put(delivery.receiver, node.handle(delivery.message, clock.now_ns))
                queue = self._queue
        if stop():
            return False
        if pace is not None:
            pace(t_ns)
        clock.now_ns = max(clock.now_ns, t_ns)
        return True

    def _put(self, sender: str, effects: Iterable[Effect]) -> None:
        now = self._clock.now_ns
        for effect in effects:
            if isinstance(effect, Send):
                for receiver in self._listeners.get(effect.topic, ()):
                    delay = self._link(sender, receiver, effect.message)
                    if delay is not None:
                        self._push(now + delay, receiver, effect.message)
            else:
                self._push(max(effect.t_ns, now), sender, Wake())

    def _push(self, t_ns: int, receiver: str, message: Message) -> None:
        self._count += 1
        heapq.heappush(self._queue, _Delivery(t_ns, self._random(), self._count, receiver, message))
