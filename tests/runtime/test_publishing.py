"""A server answers a tick once, keeps what it said, and never says two things about one frame."""

from __future__ import annotations

from collections.abc import Iterable

from colony.runtime.messages import Effect, Fetch, Sample, Send, ServerFrame, Tick
from colony.runtime.servers.publishing import Fields, Publisher


def publisher(keep: int = 3) -> Publisher:
    reads = iter(range(100))

    def read(tick: Tick) -> Fields:
        return {"x": Sample(float(next(reads)), tick.t_ns)}

    return Publisher("S", read, keep=keep)


def tick(k: int) -> Tick:
    return Tick(k=k, t_ns=k * 50)


def frame_of(effects: Iterable[Effect]) -> ServerFrame:
    (sent,) = effects
    assert isinstance(sent, Send)
    assert sent.topic == "S/frames"
    assert isinstance(sent.message, ServerFrame)
    return sent.message


def test_a_tick_is_answered_once_and_can_be_fetched_again() -> None:
    server = publisher()
    first = frame_of(server.handle(tick(0)))
    assert first == ServerFrame(server="S", k=0, fields={"x": Sample(0.0, 0)})
    assert server.handle(tick(0)) == ()
    assert frame_of(server.handle(Fetch(server="S", k=0))) == first


def test_the_frame_of_a_tick_that_never_came_has_no_values_for_everybody() -> None:
    server = publisher()
    server.handle(tick(0))
    server.handle(tick(2))
    empty = frame_of(server.handle(Fetch(server="S", k=1)))
    assert empty.fields == {}
    assert server.handle(tick(1)) == ()
    assert frame_of(server.handle(Fetch(server="S", k=1))) == empty


def test_of_the_future_and_of_what_is_forgotten_it_says_nothing() -> None:
    server = publisher(keep=2)
    for k in range(4):
        server.handle(tick(k))
    assert server.handle(Fetch(server="S", k=1)) == ()
    assert server.handle(Fetch(server="S", k=9)) == ()
    assert server.handle(tick(1)) == ()
    assert frame_of(server.handle(Fetch(server="S", k=2))).k == 2
