"""The transport in virtual time: seeded, in order of time, with faults where a link makes them."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import pytest

from colony.runtime.protocol.messages import (
    Effect,
    Fetch,
    Malformed,
    Message,
    SendMessage,
    Tick,
    Wake,
    WakeAt,
)
from colony.runtime.transport.faults import FaultRates, LinkFaults
from colony.runtime.transport.virtual import VirtualClock, VirtualTransport


class Echo:
    """Notes what it gets, and says something at its start."""

    def __init__(
        self, address: str, *, listens: tuple[str, ...] = ("news",), says: tuple[Effect, ...] = ()
    ) -> None:
        self.address = address
        self.listens = listens
        self.says = says
        self.heard: list[tuple[int, Message]] = []

    def start(self, now_ns: int) -> Iterable[Effect]:
        return self.says

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        self.heard.append((now_ns, message))
        return ()

    def close(self) -> None:
        pass


def news(k: int) -> SendMessage:
    return SendMessage("news", Fetch(server="s", k=k))


def heard(seed: int) -> list[int]:
    reader = Echo("reader")
    transport = VirtualTransport(VirtualClock(), seed=seed)
    transport.add(reader)
    transport.add(Echo("writer", listens=(), says=tuple(news(k) for k in range(8))))
    transport.run_until(1)
    return [m.k for _, m in reader.heard if isinstance(m, Fetch)]


def test_messages_of_one_moment_come_in_an_order_drawn_from_the_seed() -> None:
    orders = {tuple(heard(seed)) for seed in range(20)}
    assert len(orders) > 10
    assert all(sorted(order) == list(range(8)) for order in orders)
    assert heard(3) == heard(3)


def test_wakes_come_at_their_time_or_at_once() -> None:
    clock = VirtualClock(100)
    sleeper = Echo("sleeper", says=(WakeAt(300), WakeAt(50)))
    transport = VirtualTransport(clock, seed=0)
    transport.add(sleeper)
    assert transport.run_until(300)
    assert sleeper.heard == [(100, Wake())]
    assert clock() == 300
    transport.run_until(301)
    assert sleeper.heard[-1] == (300, Wake())


def test_a_link_delays_and_drops() -> None:
    def link(sender: str, receiver: str, message: Message) -> int | None:
        return {"far": 70, "cut off": None}.get(receiver, 0)

    nodes = [Echo("near"), Echo("far"), Echo("cut off")]
    transport = VirtualTransport(VirtualClock(), seed=0, link=link)
    for node in nodes:
        transport.add(node)
    transport.add(Echo("writer", listens=(), says=(news(1),)))
    transport.run_until(100)
    assert [[t for t, _ in node.heard] for node in nodes] == [[0], [70], []]


def test_a_killed_node_gets_nothing_and_can_be_replaced() -> None:
    transport = VirtualTransport(VirtualClock(), seed=0)
    first, second = Echo("a", says=(WakeAt(10),)), Echo("a")
    transport.add(first)
    assert transport.kill("a") is first
    transport.add(second)
    transport.add(Echo("writer", listens=(), says=(news(1),)))
    transport.run_until(100)
    assert first.heard == []
    assert len(second.heard) == 1
    with pytest.raises(ValueError, match="two nodes"):
        transport.add(Echo("a"))


def test_stop_is_asked_between_moments_and_pace_told_every_one() -> None:
    told: list[int] = []
    sleeper = Echo("sleeper", says=tuple(WakeAt(t) for t in (0, 10, 10, 20, 30)))
    transport = VirtualTransport(VirtualClock(), seed=0)
    transport.add(sleeper)
    assert not transport.run_until(100, stop=lambda: len(sleeper.heard) >= 3, pace=told.append)
    assert [t for t, _ in sleeper.heard] == [0, 10, 10]
    assert told == [10]
    assert transport.run_until(100, pace=told.append)
    assert told == [10, 20, 30, 100]


def test_ticks_are_messages_like_any_other() -> None:
    reader = Echo("reader", listens=("Clock/ticks",))
    transport = VirtualTransport(VirtualClock(), seed=0)
    transport.add(reader)
    transport.add(
        Echo(
            "w",
            listens=(),
            says=(
                SendMessage("Clock/ticks", Tick(k=0, t_ns=0)),
                SendMessage("nobody", Fetch(server="s", k=0)),
            ),
        )
    )
    transport.run_until(1)
    assert reader.heard == [(0, Tick(k=0, t_ns=0))]


# --- faults --------------------------------------------------------------------------------------


def test_a_frozen_node_gets_what_waited_in_order_when_it_goes_on() -> None:
    reader = Echo("reader", says=(WakeAt(30),))
    transport = VirtualTransport(VirtualClock(), seed=0)
    transport.add(reader)
    transport.freeze("reader")
    for k in range(5):
        transport.at(10 * k, lambda k=k: transport.inject("news", Fetch(server="s", k=k)))  # type: ignore[misc]
    transport.at(100, lambda: transport.thaw("reader"))
    transport.at(100, lambda: transport.thaw("reader"))
    transport.run_until(100)
    assert reader.heard == []
    transport.run_until(101)
    assert [t for t, _ in reader.heard] == [100] * 6
    assert [m.k for _, m in reader.heard if isinstance(m, Fetch)] == [0, 1, 2, 3, 4]
    with pytest.raises(KeyError):
        transport.freeze("nobody")


def test_a_link_doubles() -> None:
    reader = Echo("reader")
    transport = VirtualTransport(VirtualClock(), seed=0, link=lambda *_: (0, 7, 7))
    transport.add(reader)
    transport.inject("news", Fetch(server="s", k=1))
    transport.run_until(10)
    assert [t for t, _ in reader.heard] == [0, 7, 7]


def test_what_no_node_sends_can_be_put_in() -> None:
    reader = Echo("reader")
    transport = VirtualTransport(VirtualClock(5), seed=0)
    transport.add(reader)
    garbage = Malformed(topic="news", connection=None, reason="no message")
    transport.inject("news", garbage)
    transport.run_until(6)
    assert reader.heard == [(5, garbage)]
    assert transport.addresses == ("reader",)


def test_nothing_leaves_before_a_node_has_settled() -> None:
    log: list[str] = []

    class Storing(Echo):
        unsettled = True

        def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
            log.append("handles")
            yield SendMessage("out", message)  # type: ignore[arg-type]
            log.append("has handled")

        def settle(self) -> Callable[[], None]:
            return lambda: log.append("settles")

    class Reading(Echo):
        def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
            log.append("reads")
            return ()

    transport = VirtualTransport(VirtualClock(), seed=0)
    transport.add(Storing("server", listens=("in",)))
    transport.add(Reading("reader", listens=("out",)))
    log.clear()
    transport.inject("in", Fetch(server="s", k=1))
    transport.run_until(1)
    assert log == ["handles", "has handled", "settles", "reads"]


def test_faults_are_those_of_the_seed() -> None:
    rates = FaultRates(lost=0.1, duplicated=0.1, late=0.1, reordered=0.2, late_ns=1000, reordered_ns=10)
    message = Fetch(server="s", k=0)
    first, again = (
        [one("a", "b", message) for _ in range(50)] for one in (LinkFaults(3, rates), LinkFaults(3, rates))
    )
    assert first == again
    one = LinkFaults(7, rates, exempt=lambda sender, receiver, message: receiver == "spared")
    drawn = [one("a", "b", message) for _ in range(10_000)]
    assert 800 < sum(d is None for d in drawn) < 1200
    assert 800 < sum(isinstance(d, tuple) and len(d) == 2 for d in drawn) < 1200
    late = [d for d in drawn if isinstance(d, int)]
    assert 800 < sum(d > 10 for d in late) < 1200
    assert 1500 < sum(0 < d <= 10 for d in late) < 2300
    assert all(one("a", "spared", message) == 0 for _ in range(100))
