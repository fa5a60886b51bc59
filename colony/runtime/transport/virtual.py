"""A transport within one process and in virtual time, with a seeded scheduler.

The queue of an `Exchange` stands in for the network. Messages due at the same time are delivered in an order
drawn from the seed, so that different seeds cover the orders that a network could produce, and each run can
be repeated. A `Link` delays, drops and duplicates messages where a test needs faults (`faults.py`). Nodes can
be killed, frozen and restarted at any time.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable

from colony.runtime.protocol.messages import Effect, Message, Node, SendMessage
from colony.runtime.transport.exchange import (
    Action,
    Delivery,
    Exchange,
    Link,
    Member,
    deliver_immediately,
)


class VirtualClock:
    """The current time of a virtual run, in nanoseconds. Mutable: its transport advances it."""

    def __init__(self, now_ns: int = 0) -> None:
        self.now_ns = now_ns

    def __call__(self) -> int:
        """Return the current time in nanoseconds."""
        return self.now_ns


OUTSIDE = "outside"
"""The sender of injected messages."""


class VirtualTransport:
    """Delivers messages from nodes to listeners. Mutable."""

    def __init__(self, clock: VirtualClock, *, seed: int, link: Link = deliver_immediately) -> None:
        self._clock = clock
        self._exchange = Exchange(clock, order=random.Random(seed).random, link=link)
        self._frozen: dict[str, list[Message]] = {}

    @property
    def addresses(self) -> tuple[str, ...]:
        """The addresses of the live nodes, in the order in which they were started."""
        return tuple(member.address for member in self._exchange.members)

    # --- nodes -----------------------------------------------------------------------------------------

    def add(self, node: Node) -> None:
        """Start a node; it may reuse the address of a killed node."""
        member = self._exchange.add(node)
        self._carry_out(member, self._exchange.start(member))

    def kill(self, address: str) -> Node:
        """Remove a node without notice, as a crash would; messages in transit to it are lost."""
        self._frozen.pop(address, None)
        return self._exchange.remove(address)

    def freeze(self, address: str) -> None:
        """Stop a node as SIGSTOP would: messages to it wait."""
        if self._exchange.member(address) is None:
            raise KeyError(address)
        self._frozen.setdefault(address, [])

    def thaw(self, address: str) -> None:
        """Resume a frozen node: the waiting messages arrive now, in order of arrival."""
        member = self._exchange.member(address)
        for message in self._frozen.pop(address, ()):
            assert member is not None
            self._exchange.put(member, message)

    # --- input from outside --------------------------------------------------------------------------------

    def inject(self, topic: str, message: Message) -> None:
        """Deliver a message to every listener of `topic` now, even one that no node sends (`Malformed`)."""
        self._exchange.post(OUTSIDE, topic, message)

    def at(self, t_ns: int, action: Action) -> None:
        """Run an action at `t_ns`, before any message due at that time."""
        self._exchange.at(t_ns, action)

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
        clock, exchange = self._clock, self._exchange
        while (due := exchange.next_ns) < t_ns:
            if due > clock.now_ns:
                if stop():
                    return False
                if pace is not None:
                    pace(due)
                clock.now_ns = due
            delivery = exchange.pop(due)
            assert delivery is not None
            self._deliver(delivery)
        if stop():
            return False
        if pace is not None:
            pace(t_ns)
        clock.now_ns = max(clock.now_ns, t_ns)
        return True

    def _deliver(self, delivery: Delivery) -> None:
        receiver, content = delivery.receiver, delivery.content
        if callable(content):
            content()
        elif receiver is not None:
            if receiver.address in self._frozen:
                self._frozen[receiver.address].append(content)
            else:
                self._carry_out(receiver, receiver.node.handle(content, self._clock.now_ns))

    def _carry_out(self, sender: Member, effects: Iterable[Effect]) -> None:
        """Carry out effects as the node yields them; those of a node that settles after it has settled."""
        if sender.settling is not None:
            effects = list(effects)
            if (finish := self._exchange.settle(sender)) is not None:
                finish()
        for effect in effects:
            if isinstance(effect, SendMessage):
                self._exchange.post(sender.address, effect.topic, effect.message)
            else:
                self._exchange.wake_at(sender, effect.t_ns)
