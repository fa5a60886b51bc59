"""A server answers a tick once, keeps what it said, and never says two things about one frame."""

from __future__ import annotations

from collections.abc import Iterable

from colony.runtime.messages import Announcement, Effect, Fetch, Sample, Send, ServerFrame, Tick
from colony.runtime.servers.publishing import Fields, Publisher
from colony.runtime.servers.relaying import ActivityRelay


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
    server.handle(tick(3))
    assert frame_of(server.handle(Fetch(server="S", k=1))) == empty


def test_of_what_came_before_its_first_tick_it_knows_nothing() -> None:
    server = publisher()
    assert server.handle(Fetch(server="S", k=4)) == ()
    assert frame_of(server.handle(tick(5))).since == 5
    assert server.handle(Fetch(server="S", k=4)) == ()
    assert server.handle(tick(4)) == ()
    assert frame_of(server.handle(tick(6))).since == 5


def test_the_activity_of_modules_is_handed_on_once_and_kept() -> None:
    relay = ActivityRelay("D", ("pulse",), keep=2)
    name = "D/activity/pulse"
    for k, active in ((0, True), (2, False), (1, True)):
        told = Announcement(k=k, module="pulse", active=active)
        (sent,) = relay.announce(told, 7)
        frame = ServerFrame(server=name, k=k, fields={"active": Sample(active, 7)})
        assert sent == Send("D/activity/pulse/frames", frame)
        assert relay.announce(told, 8) == ()
    assert relay.announce(Announcement(k=0, module="stranger", active=True), 7) == ()
    assert relay.fetch(Fetch(server=name, k=0)) == ()
    assert relay.fetch(Fetch(server=name, k=1)) == (Send("D/activity/pulse/frames", frame),)
    relay.deploy(("other",))
    assert relay.fetch(Fetch(server=name, k=1)) == ()
    assert relay.listens == ("D/announcements", "D/fetches")


def test_of_the_future_and_of_what_is_forgotten_it_says_nothing() -> None:
    server = publisher(keep=2)
    for k in range(4):
        server.handle(tick(k))
    assert server.handle(Fetch(server="S", k=1)) == ()
    assert server.handle(Fetch(server="S", k=9)) == ()
    assert server.handle(tick(1)) == ()
    assert frame_of(server.handle(Fetch(server="S", k=2))).k == 2
