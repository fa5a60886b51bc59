"""A transport within one process and in virtual time, with a seeded scheduler.

A queue stands in for the network. Messages due at the same time are delivered in an order drawn from the
seed, so that different seeds cover the orders that a network could produce, and each run can be repeated. A
`Link` delays, drops and duplicates messages where a test needs faults (`faults.py`). Nodes can be killed,
frozen and restarted at any time.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Iterable
from typing import NamedTuple

from colony.runtime.protocol.messages import Effect, Message, Node, Send, SettlingNode, Wake


class VirtualClock:
    """The current time of a virtual run, in nanoseconds. Mutable: its transport advances it."""

    def __init__(self, now_ns: int = 0) -> None:
        self.now_ns = now_ns

    def __call__(self) -> int:
        """Return the current time in nanoseconds."""
        return self.now_ns


Delay = int | None | tuple[int, ...]
"""Delay of a message in nanoseconds; None if it is lost; a tuple has one delay per copy."""

Link = Callable[[str, str, Message], Delay]
"""A function that returns the delay of a message from a sender to a receiver (addresses)."""


def deliver_immediately(sender: str, receiver: str, message: Message) -> Delay:
    """Deliver every message at once."""
    return 0


Action = Callable[[], object]


class _Delivery(NamedTuple):
    t_ns: int
    order: float
    number: int
    receiver: str
    message: Message | Action


OUTSIDE = "outside"
"""The sender of injected messages."""


class VirtualTransport:
    """Delivers messages from nodes to listeners. Mutable."""

    def __init__(self, clock: VirtualClock, *, seed: int, link: Link = deliver_immediately) -> None:
        self._clock = clock
        self._link = link
        self._random = random.Random(seed).random
        self._nodes: dict[str, Node] = {}
        self._settling: dict[str, SettlingNode] = {}
        self._frozen: dict[str, list[Message]] = {}
        self._listeners: dict[str, list[str]] = {}
        self._queue: list[_Delivery] = []
        self._count = 0

    @property
    def addresses(self) -> tuple[str, ...]:
        """The addresses of the live nodes, in the order in which they were started."""
        return tuple(self._nodes)

    # --- nodes -----------------------------------------------------------------------------------------

    def add(self, node: Node) -> None:
        """Start a node; it may reuse the address of a killed node."""
        address = node.address
        if address in self._nodes:
            raise ValueError(f"there are two nodes with the address {address}")
        self._nodes[address] = node
        if isinstance(node, SettlingNode):
            self._settling[address] = node
        for topic in dict.fromkeys(node.listens):
            self._listeners.setdefault(topic, []).append(address)
        self._carry_out(address, node.start(self._clock.now_ns))

    def kill(self, address: str) -> Node:
        """Remove a node without notice, as a crash would; messages in transit to it are lost."""
        node = self._nodes.pop(address)
        self._settling.pop(address, None)
        self._frozen.pop(address, None)
        for topic in dict.fromkeys(node.listens):
            self._listeners[topic].remove(address)
        self._queue = [d for d in self._queue if d.receiver != address]
        heapq.heapify(self._queue)
        return node

    def freeze(self, address: str) -> None:
        """Stop a node as SIGSTOP would: messages to it wait."""
        if address not in self._nodes:
            raise KeyError(address)
        self._frozen.setdefault(address, [])

    def thaw(self, address: str) -> None:
        """Resume a frozen node: the waiting messages arrive now, in order of arrival."""
        for message in self._frozen.pop(address, ()):
            self._put(self._clock.now_ns, 0.0, address, message)

    # --- input from outside --------------------------------------------------------------------------------

    def inject(self, topic: str, message: Message) -> None:
        """Deliver a message to every listener of `topic` now, even one that no node sends (`Malformed`)."""
        self._send(OUTSIDE, topic, message)

    def at(self, t_ns: int, action: Action) -> None:
        """Run an action at `t_ns`, before any message due at that time."""
        self._put(max(t_ns, self._clock.now_ns), -1.0, "", action)

    # --- time --------------------------------------------------------------------------------------------

    def run_until(
        self,
        t_ns: int,
        *,
        stop: Callable[[], bool] = lambda: False,
        pace: Callable[[int], None] | None = None,
    ) -> bool:
        """Deliver everything that is due before `t_ns`, and advance the clock to `t_ns`.

        `pace` is called with each new time before anything happens at it (a run at wall-clock speed sleeps
        there). Return False if `stop` ended the run; `stop` is checked only before time advances.
        """
        clock = self._clock
        while self._queue and self._queue[0].t_ns < t_ns:
            due = self._queue[0].t_ns
            if due > clock.now_ns:
                if stop():
                    return False
                if pace is not None:
                    pace(due)
                clock.now_ns = due
            _, _, _, receiver, message = heapq.heappop(self._queue)
            self._deliver(receiver, message)
        if stop():
            return False
        if pace is not None:
            pace(t_ns)
        clock.now_ns = max(clock.now_ns, t_ns)
        return True

    def _deliver(self, receiver: str, message: Message | Action) -> None:
        if not receiver:
            assert callable(message)
            message()
            return
        assert not callable(message)
        node = self._nodes.get(receiver)
        if node is None:
            return
        if receiver in self._frozen:
            self._frozen[receiver].append(message)
            return
        self._carry_out(receiver, node.handle(message, self._clock.now_ns))

    def _carry_out(self, sender: str, effects: Iterable[Effect]) -> None:
        if sender in self._settling:
            effects = list(effects)  # settle after all messages are handled and before any effect is sent
            self._settling[sender].settle()
        now = self._clock.now_ns
        for effect in effects:
            if isinstance(effect, Send):
                self._send(sender, effect.topic, effect.message)
            else:
                self._put(max(effect.t_ns, now), self._random(), sender, Wake())

    def _send(self, sender: str, topic: str, message: Message) -> None:
        now, link = self._clock.now_ns, self._link
        for receiver in self._listeners.get(topic, ()):
            delay = link(sender, receiver, message)
            if delay is None:
                continue
            for delay_ns in delay if isinstance(delay, tuple) else (delay,):
                self._put(now + delay_ns, self._random(), receiver, message)

    def _put(self, t_ns: int, order: float, receiver: str, message: Message | Action) -> None:
        self._count += 1
        heapq.heappush(self._queue, _Delivery(t_ns, order, self._count, receiver, message))
