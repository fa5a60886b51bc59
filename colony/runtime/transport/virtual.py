"""A transport within one process and in virtual time, with a seeded scheduler.

The very same nodes that a network joins are joined here by a queue. Messages due at the same moment are
delivered in an order drawn from the seed, so that a run never shows just one of the orders that a network
could bring about, and yet can be repeated. A `Link` delays, drops and doubles messages where a test wants
faults (`faults.py`), and nodes are killed, frozen and started anew at any moment.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Iterable
from typing import NamedTuple

from colony.runtime.protocol.messages import Effect, Message, Node, Send, Settling, Wake


class VirtualClock:
    """The present of a virtual run, in nanoseconds. Mutable: only its transport moves it."""

    def __init__(self, now_ns: int = 0) -> None:
        self.now_ns = now_ns

    def __call__(self) -> int:
        return self.now_ns


Delay = int | None | tuple[int, ...]
"""By how many nanoseconds a message is late; None: it is lost; several: so many copies arrive."""

Link = Callable[[str, str, Message], Delay]
"""From sender to receiver (addresses): what becomes of a message."""


def perfect(sender: str, receiver: str, message: Message) -> Delay:
    """Every message arrives, at once."""
    return 0


Action = Callable[[], object]


class _Delivery(NamedTuple):
    t_ns: int
    order: float
    number: int
    receiver: str
    message: Message | Action


OUTSIDE = "outside"
"""The sender of what tests put in."""


class VirtualTransport:
    """Delivers what nodes send to those that listen. Mutable: the queue, and who lives."""

    def __init__(self, clock: VirtualClock, *, seed: int, link: Link = perfect) -> None:
        self._clock = clock
        self._link = link
        self._random = random.Random(seed).random
        self._nodes: dict[str, Node] = {}
        self._settling: dict[str, Settling] = {}
        self._frozen: dict[str, list[Message]] = {}
        self._listeners: dict[str, list[str]] = {}
        self._queue: list[_Delivery] = []
        self._count = 0

    @property
    def addresses(self) -> tuple[str, ...]:
        """Of the nodes that live, in the order in which they were started."""
        return tuple(self._nodes)

    # --- nodes -----------------------------------------------------------------------------------------

    def add(self, node: Node) -> None:
        """Start a node. One of the same address takes the place of one that was killed."""
        address = node.address
        if address in self._nodes:
            raise ValueError(f"there are two nodes with the address {address}")
        self._nodes[address] = node
        if isinstance(node, Settling):
            self._settling[address] = node
        for topic in dict.fromkeys(node.listens):
            self._listeners.setdefault(topic, []).append(address)
        self._carry_out(address, node.start(self._clock.now_ns))

    def kill(self, address: str) -> Node:
        """Take a node away without a word, as a crash would; what was on its way to it is lost."""
        node = self._nodes.pop(address)
        self._settling.pop(address, None)
        self._frozen.pop(address, None)
        for topic in dict.fromkeys(node.listens):
            self._listeners[topic].remove(address)
        self._queue = [d for d in self._queue if d.receiver != address]
        heapq.heapify(self._queue)
        return node

    def freeze(self, address: str) -> None:
        """Stop a node as SIGSTOP would: what is sent to it waits."""
        if address not in self._nodes:
            raise KeyError(address)
        self._frozen.setdefault(address, [])

    def thaw(self, address: str) -> None:
        """Let a frozen node go on: what waited arrives now, in the order in which it came."""
        for message in self._frozen.pop(address, ()):
            self._put(self._clock.now_ns, 0.0, address, message)

    # --- what comes from outside -------------------------------------------------------------------------

    def inject(self, topic: str, message: Message) -> None:
        """Deliver this to every node that listens to `topic`, now; also what no node sends (`Malformed`)."""
        self._send(OUTSIDE, topic, message)

    def at(self, t_ns: int, action: Action) -> None:
        """Do something to the nodes at `t_ns`, before any message of that moment."""
        self._put(max(t_ns, self._clock.now_ns), -1.0, "", action)

    # --- time --------------------------------------------------------------------------------------------

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
            effects = list(effects)  # all is handled before it settles, and settled before any of it leaves
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
            for late_ns in delay if isinstance(delay, tuple) else (delay,):
                self._put(now + late_ns, self._random(), receiver, message)

    def _put(self, t_ns: int, order: float, receiver: str, message: Message | Action) -> None:
        self._count += 1
        heapq.heappush(self._queue, _Delivery(t_ns, order, self._count, receiver, message))
