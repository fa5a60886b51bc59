"""A server answers a tick once, keeps what it said, and never says two things about one frame."""

from __future__ import annotations

from collections.abc import Iterable

from colony.ir.frame import Answer
from colony.runtime.frames.publishing import (
    KEPT_BYTES,
    MAX_REPUBLISHED_BYTES,
    MAX_REPUBLISHED_FRAMES,
    Fields,
    Publisher,
)
from colony.runtime.protocol.messages import (
    Announcement,
    Effect,
    Fetch,
    Sample,
    SendMessage,
    ServerFrame,
    Tick,
)
from colony.runtime.servers.dserver import ActivityRelay


def publisher(frames_kept: int = 3) -> Publisher:
    reads = iter(range(100))

    def read(tick: Tick) -> Fields:
        return {"x": Sample(float(next(reads)), tick.t_ns)}

    return Publisher("S", read, frames_kept=frames_kept)


def tick(k: int) -> Tick:
    return Tick(k=k, t_ns=k * 50)


def frame_of(effects: Iterable[Effect]) -> ServerFrame:
    (sent,) = effects
    assert sent.topic == "S/frames"
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


def test_the_answers_of_modules_are_handed_on_once_and_kept() -> None:
    relay = ActivityRelay("D", ("pulse",), frames_kept=2)
    name = "D/activity/pulse"
    answers = {0: Answer((50.0, True)), 3: Answer(blind=True), 2: Answer(), 1: Answer((), error=True)}
    for k, answer in answers.items():
        told = Announcement(k=k, module="pulse", answer=answer)
        (sent,) = relay.announce(told, 7)
        command = None if answer.values is None else Sample(answer.values, 7)
        flags = {"error": Sample(answer.error, 7), "blind": Sample(answer.blind, 7)}
        frame = ServerFrame(server=name, k=k, fields={"command": command, **flags})
        assert sent == SendMessage("D/activity/pulse/frames", frame)
        assert relay.announce(told, 8) == ()
    assert relay.announce(Announcement(k=0, module="stranger", answer=Answer((300.0, 5.0))), 7) == ()
    unkept = Fetch(server=name, k=0)
    assert relay.fetch(unkept) == (SendMessage("D/repeats/pulse", unkept),)
    assert relay.fetch(unkept) == ()  # once a frame
    assert relay.fetch(Fetch(server=name, k=1)) == (SendMessage("D/activity/pulse/frames", frame),)
    relay.deploy(("other",))
    assert relay.fetch(Fetch(server=name, k=1)) == ()
    assert relay.listens == ("D/announcements", "D/fetches")


def test_of_the_future_and_of_what_is_forgotten_it_says_nothing() -> None:
    server = publisher(frames_kept=2)
    for k in range(4):
        server.handle(tick(k))
    assert server.handle(Fetch(server="S", k=1)) == ()
    assert server.handle(Fetch(server="S", k=9)) == ()
    assert server.handle(tick(1)) == ()
    assert frame_of(server.handle(Fetch(server="S", k=2))).k == 2


# --- fetches -------------------------------------------------------------------------------------


def fetched(server: Publisher, ks: Iterable[int]) -> list[int]:
    """The frames that are published again."""
    return [
        effect.message.k
        for k in ks
        for effect in server.handle(Fetch(server="S", k=k))
        if isinstance(effect, SendMessage) and isinstance(effect.message, ServerFrame)
    ]


def test_a_frame_is_published_again_once_between_two_ticks() -> None:
    server = publisher(frames_kept=10)
    for k in range(3):
        server.handle(tick(k))
    assert fetched(server, [0, 1, 0, 0, 1]) == [0, 1]
    server.handle(tick(2))
    assert fetched(server, [0]) == [], "a tick that comes twice begins nothing"
    server.handle(tick(3))
    assert fetched(server, [0, 0]) == [0]


def test_so_many_frames_are_published_again_between_two_ticks() -> None:
    server = Publisher("S", lambda tick: {}, frames_kept=1000)
    for k in range(0, 400, 2):
        server.handle(tick(k))
    assert fetched(server, range(398)) == list(range(MAX_REPUBLISHED_FRAMES))
    server.handle(tick(400))
    assert fetched(server, range(300, 398)) == list(range(300, 300 + MAX_REPUBLISHED_FRAMES))


def test_so_many_bytes_are_published_again_between_two_ticks() -> None:
    fields = {"x": Sample((0.5,) * 20_000, 0)}
    server = Publisher("S", lambda tick: fields, frames_kept=1000)
    for k in range(20):
        server.handle(tick(k))
    assert fetched(server, range(20)) == list(range(MAX_REPUBLISHED_BYTES // 180_000))


def test_a_frame_larger_than_the_budget_is_published_again_all_the_same() -> None:
    server = Publisher("S", lambda tick: {"x": Sample((0.5,) * 200_000, 0)}, frames_kept=10)
    for k in range(3):
        server.handle(tick(k))
    assert fetched(server, [0, 1]) == [0]


def test_frames_that_are_kept_have_so_many_bytes() -> None:
    server = Publisher("S", lambda tick: {"x": Sample((0.5,) * 50_000, tick.k)}, frames_kept=1000)
    for k in range(100):
        server.handle(tick(k))
    most = KEPT_BYTES // 450_000
    (said,) = server.limit_messages
    assert said == f"frames: {most} of 1000 are kept, because of the limit of 16 MiB"
    assert fetched(server, [0, 99 - most]) == []
    assert fetched(server, [100 - most, 99]) == [100 - most, 99]


def test_fields_that_frames_share_count_once() -> None:
    shared = {"x": Sample((0.5,) * 50_000, 0)}
    server = Publisher("S", lambda tick: shared, frames_kept=1000)
    for k in range(900):
        server.handle(tick(k))
    assert server.limit_messages == ()
    assert fetched(server, [0, 899]) == [0, 899]
    changing = iter(range(10_000))
    server = Publisher("S", lambda tick: shared if next(changing) % 100 else dict(shared), frames_kept=50)
    for k in range(5000):
        server.handle(tick(k))
    assert server.limit_messages == (), "what was forgotten leaves its room"


def test_what_is_kept_of_answers_is_bounded_in_bytes() -> None:
    relay = ActivityRelay("D", ("pulse", "other"), frames_kept=1_000_000)
    large = tuple(float(i) for i in range(7_000))
    for k in range(400):
        relay.announce(Announcement(k=k, module="pulse", answer=Answer(large)), 7)
    again = []
    for k in range(400):
        relay.tick()
        (sent,) = relay.fetch(Fetch(server="D/activity/pulse", k=k))
        again += [k] if isinstance(sent, SendMessage) and isinstance(sent.message, ServerFrame) else []
    assert again[-1] == 399
    assert len(again) * 9 * len(large) <= KEPT_BYTES // 2 < (len(again) + 2) * 9 * len(large)


def test_activities_are_handed_on_again_at_a_bounded_rate() -> None:
    relay = ActivityRelay("D", ("pulse",), frames_kept=1000)
    for k in range(200):
        relay.announce(Announcement(k=k, module="pulse", answer=Answer((300.0, 5.0))), 7)
    name = "D/activity/pulse"

    def again(ks: Iterable[int]) -> int:
        return sum(len(tuple(relay.fetch(Fetch(server=name, k=k)))) for k in ks)

    assert again([1, 1, 2]) == 2
    assert again(range(200)) == MAX_REPUBLISHED_FRAMES - 2
    relay.tick()
    assert again([1]) == 1
