"""The nodes of a process, and the messages that they hand to each other in memory, for live and virtual time.

A message reaches a node of the same process as the object that was sent. In live time messages are handed
over in the order in which they were sent, before any wake that is due. In virtual time they have a delay, and
what is due at one time is delivered in an order that `order` draws. Each node has a lock: another thread can
hand an emergency stop to one node while a different one is busy.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Iterable
from threading import Event, Lock
from typing import NamedTuple

from colony.runtime.protocol.messages import Effect, Message, Node, SettlingNode, Wake

Delay = int | None | tuple[int, ...]
"""Delay of a message in nanoseconds; None if it is lost; a tuple has one delay per copy."""

Link = Callable[[str, str, Message], Delay]
"""A function that returns the delay of a message from a sender to a receiver (addresses)."""

Action = Callable[[], object]

NEVER_NS = 1 << 63
"""A time that is never reached."""


def deliver_immediately(sender: str, receiver: str, message: Message) -> Delay:
    """Deliver every message at once."""
    return 0


def in_order() -> float:
    """Return the same for all messages, which keeps them in the order in which they are sent."""
    return 0.0


class Member:
    """A node in an exchange, its lock, and itself once more if its effects have to be settled.

    Once it is `removed`, it gets nothing more, also nothing that another thread had in hand for it.
    While an emergency stop waits for the node, `no_stop_waits` is cleared: nothing else may come between.
    """

    __slots__ = ("address", "lock", "no_stop_waits", "node", "removed", "settling")

    def __init__(self, node: Node) -> None:
        self.address = node.address
        self.node = node
        self.lock = Lock()
        self.removed = False
        self.no_stop_waits = Event()
        self.no_stop_waits.set()
        self.settling = node if isinstance(node, SettlingNode) else None


class Delivery(NamedTuple):
    """A message for a node, or an action for nobody, due at `t_ns`."""

    t_ns: int
    order: float
    number: int
    receiver: Member | None
    content: Message | Action


class Exchange:
    """The nodes of a process and what waits for them. Mutable. Threads may share it."""

    def __init__(
        self,
        time: Callable[[], int],
        *,
        order: Callable[[], float] = in_order,
        link: Link = deliver_immediately,
    ) -> None:
        """Create an exchange without nodes.

        Args:
            time: the time in nanoseconds.
            order: returns what decides between two messages that are due at one time, the lower one first.
            link: returns the delay of each message.
        """
        self._time = time
        self._order = order
        self._link = link
        self._members: dict[str, Member] = {}
        self._listeners: dict[str, tuple[Member, ...]] = {}
        self._handed_over: deque[tuple[Member, Message]] = deque()
        self._queue: list[Delivery] = []
        self._count = 0
        self._lock = Lock()

    @property
    def members(self) -> tuple[Member, ...]:
        """The nodes, in the order in which they were added."""
        return tuple(self._members.values())

    def member(self, address: str) -> Member | None:
        """Return the node with this address, if it is here."""
        return self._members.get(address)

    def listeners(self, topic: str) -> tuple[Member, ...]:
        """Return the nodes that listen to a topic."""
        return self._listeners.get(topic, ())

    # --- nodes ---------------------------------------------------------------------------------------

    def add(self, node: Node) -> Member:
        """Add a node, which begins to receive; it may reuse the address of a removed node.

        Raises:
            ValueError: another node has its address.
        """
        if node.address in self._members:
            raise ValueError(f"there are two nodes with the address {node.address}")
        member = self._members[node.address] = Member(node)
        for topic in dict.fromkeys(node.listens):
            self._listeners[topic] = (*self.listeners(topic), member)
        return member

    def remove(self, address: str) -> Node:
        """Remove a node, once no other thread uses it, as a crash would; what waits for it is lost."""
        member = self._members.pop(address)
        with member.lock:
            member.removed = True
        for topic in dict.fromkeys(member.node.listens):
            self._listeners[topic] = tuple(m for m in self._listeners[topic] if m is not member)
        with self._lock:
            self._queue = [delivery for delivery in self._queue if delivery.receiver is not member]
            heapq.heapify(self._queue)
        return member.node

    def start(self, member: Member) -> Iterable[Effect]:
        """Start a node, and return its effects."""
        with member.lock:
            return tuple(member.node.start(self._time()))

    def handle(self, member: Member, message: Message) -> tuple[Effect, ...]:
        """Let a node handle a message, once no other thread uses the node, and return the effects."""
        if not member.no_stop_waits.is_set():
            member.no_stop_waits.wait()
        return self._handle(member, message)

    def handle_stop(self, member: Member, message: Message) -> tuple[Effect, ...]:
        """Let a node handle an emergency stop ahead of all other messages, and return the effects."""
        member.no_stop_waits.clear()
        try:
            return self._handle(member, message)
        finally:
            member.no_stop_waits.set()

    def _handle(self, member: Member, message: Message) -> tuple[Effect, ...]:
        with member.lock:
            return () if member.removed else tuple(member.node.handle(message, self._time()))

    def settle(self, member: Member) -> Callable[[], None] | None:
        """Return a function that finishes what a node must do before it acknowledges; None if nothing is."""
        if member.settling is None:
            return None
        with member.lock:
            return None if member.removed else member.settling.settle()

    # --- messages that come before anything else -------------------------------------------------------

    def hand_over(self, topic: str, message: Message) -> None:
        """Queue a message for all listeners of a topic, ahead of everything in the queue of times.

        No deadline passes while what it waits for is here.
        """
        for member in self._listeners.get(topic, ()):
            self._handed_over.append((member, message))

    def pop_message(self) -> tuple[Member, Message] | None:
        """Take the message that was handed over first."""
        return self._handed_over.popleft() if self._handed_over else None

    # --- the queue of times ----------------------------------------------------------------------------

    def post(self, sender: str, topic: str, message: Message) -> None:
        """Queue a message for all listeners of a topic."""
        now = self._time()
        for member in self.listeners(topic):
            delay = self._link(sender, member.address, message)
            if delay is None:
                continue
            for delay_ns in delay if isinstance(delay, tuple) else (delay,):
                self._put(now + delay_ns, self._order(), member, message)

    def wake_at(self, member: Member, t_ns: int) -> None:
        """Queue a wake."""
        self._put(max(t_ns, self._time()), self._order(), member, Wake())

    def put(self, member: Member, message: Message) -> None:
        """Queue a message for one node, ahead of what is drawn to come first now."""
        self._put(self._time(), 0.0, member, message)

    def at(self, t_ns: int, action: Action) -> None:
        """Queue an action at `t_ns`, before any message due at that time."""
        self._put(max(t_ns, self._time()), -1.0, None, action)

    @property
    def next_ns(self) -> int:
        """The time at which something is due, `NEVER_NS` if nothing waits."""
        queue = self._queue
        return queue[0].t_ns if queue else NEVER_NS

    def pop(self, until_ns: int) -> Delivery | None:
        """Take what is due first, if that is at or before `until_ns`."""
        with self._lock:
            if self._queue and self._queue[0].t_ns <= until_ns:
                return heapq.heappop(self._queue)
            return None

    def _put(self, t_ns: int, order: float, receiver: Member | None, content: Message | Action) -> None:
        with self._lock:
            self._count += 1
            heapq.heappush(self._queue, Delivery(t_ns, order, self._count, receiver, content))
