"""How a process takes part: ready again after a while, alive not too often, and a new epoch when it asks."""

from __future__ import annotations

from colony.runtime.frames.assembler import ALIVE_INTERVAL_NS, READY_INTERVAL_NS, FrameAssembler, Membership
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Ready, Restart, SendMessage, Tick

READY = SendMessage(topics.READY, Ready(client="drive/avoid", run="run"))


def tick(run: str) -> Tick:
    return Tick(k=0, t_ns=0, run=run)


def alive(k: int) -> SendMessage:
    return SendMessage(topics.READY, Ready(client="drive/avoid", run="run", k=k))


def test_it_says_that_it_is_ready_until_its_run_is_there() -> None:
    one = Membership(("drive/avoid",), "run", FrameAssembler((), run="run"))
    assert list(one.start(1000)) == [READY]
    assert list(one.on_tick(tick("other"), 1000 + READY_INTERVAL_NS - 1)) == []
    assert list(one.on_tick(tick("run"), 1000 + READY_INTERVAL_NS)) == []
    assert list(one.on_tick(tick("other"), 1000 + READY_INTERVAL_NS)) == [READY]
    assert list(one.on_tick(tick(""), 1000 + 2 * READY_INTERVAL_NS - 1)) == []
    assert list(one.on_tick(tick(""), 1000 + 2 * READY_INTERVAL_NS)) == [READY]


def test_one_that_never_started_has_said_it_at_the_beginning_of_time() -> None:
    one = Membership(("drive/avoid",), "run", FrameAssembler((), run="run"))
    assert list(one.on_tick(tick("other"), READY_INTERVAL_NS - 1)) == []
    assert list(one.on_tick(tick("other"), READY_INTERVAL_NS)) == [READY]


def test_it_tells_that_it_lives_at_most_so_often() -> None:
    one = Membership(("drive/avoid",), "run", FrameAssembler((), run="run"))
    assert list(one.on_requests_sent(5, 70)) == [alive(5)]
    assert list(one.on_requests_sent(6, 70 + ALIVE_INTERVAL_NS - 1)) == []
    assert list(one.on_requests_sent(7, 70 + ALIVE_INTERVAL_NS)) == [alive(7)]
    assert list(one.on_requests_sent(8, 70 + ALIVE_INTERVAL_NS + 1)) == []


def test_several_say_each_for_itself_that_they_are_ready_and_live_and_ask_for_an_epoch_once() -> None:
    some = Membership(("drive/avoid", "drive/cruise"), "run", FrameAssembler((), run="run"))
    assert [send.message.client for send in some.start(0)] == ["drive/avoid", "drive/cruise"]  # type: ignore[union-attr]
    assert list(some.on_requests_sent(5, 70)) == [
        SendMessage(topics.READY, Ready(client=client, run="run", k=5))
        for client in ("drive/avoid", "drive/cruise")
    ]
    assert list(some.on_requests_sent(6, 71)) == []
    assert some.restart_request(42) == SendMessage(topics.RESTARTS, Restart(client="drive/avoid", start=42))
