"""What the nodes of a process hand to each other: before what, and no more once a node is removed."""

from __future__ import annotations

from collections.abc import Callable

from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Tick, Wake
from colony.runtime.transport.exchange import NEVER_NS, Exchange
from tests.runtime.transport.live.stage import Recorder

TICK = Tick(k=1, t_ns=0)


class Storing(Recorder):
    unsettled = True

    def settle(self) -> Callable[[], None]:
        return lambda: None


def test_what_is_handed_over_keeps_its_order_and_waits_for_no_time() -> None:
    exchange = Exchange(lambda: 10)
    first, second = (exchange.add(Recorder(name, topics.TICKS)) for name in ("first", "second"))
    exchange.wake_at(second, 5)
    for k in range(2):
        exchange.hand_over(topics.TICKS, Tick(k=k, t_ns=0))
    taken = [exchange.pop_message() for _ in range(4)]
    assert [(member, message.k) for member, message in taken] == [  # type: ignore[misc,union-attr]
        (first, 0), (second, 0), (first, 1), (second, 1),
    ]  # fmt: skip
    assert exchange.pop_message() is None
    due = exchange.pop(10)
    assert due is not None
    assert (due.receiver, due.content) == (second, Wake())
    assert exchange.next_ns == NEVER_NS


def test_a_removed_node_gets_nothing_more_and_leaves_its_address() -> None:
    exchange = Exchange(lambda: 0)
    node = Storing("node", topics.TICKS)
    member = exchange.add(node)
    exchange.hand_over(topics.TICKS, TICK)
    exchange.wake_at(member, 5)
    assert exchange.remove("node") is node
    assert exchange.pop_message() == (member, TICK)
    assert exchange.pop(5) is None
    assert exchange.handle(member, TICK) == exchange.handle_stop(member, TICK) == ()
    assert exchange.settle(member) is None
    assert node.got == []
    again = exchange.add(Recorder("node", topics.TICKS))
    assert exchange.listeners(topics.TICKS) == (again,)
