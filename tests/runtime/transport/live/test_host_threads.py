"""How the nodes of a host share it: in memory, beside a slow store, and behind emergency stops."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence

import msgspec
import pytest

from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.calls import EMERGENCY_STOP
from colony.runtime.protocol.messages import (
    Call,
    Effect,
    Message,
    Notice,
    Reply,
    SendMessage,
    ServerFrame,
    Tick,
)
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.inbox import MAX_CALLS_PER_CONNECTION, MAX_DROPPABLE_BYTES
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.outbox import Outbox
from tests.kit.calling import plain_call
from tests.runtime.transport.live.outside import CALLS, SERVER, Blocked, Outside
from tests.runtime.transport.live.stage import ROBOT, Recorder, hosted, robot_address, running
from tests.waiting import until


class Storing(Recorder):
    """A server that stores what it is told; the store is as slow as the test wants. Mutable: that."""

    unsettled = True

    def __init__(self, *listens: str, on: Callable[[Message, int], Iterable[Effect]]) -> None:
        super().__init__(SERVER, *listens, on=on)
        self.busy, self.go = threading.Event(), threading.Event()
        self.finished: list[int] = []

    def settle(self) -> Callable[[], None]:
        handled = len(self.got)

        def finish() -> None:
            if handled:
                self.finished.append(handled)
                self.busy.set()
                assert self.go.wait(20)

        return finish


def test_nodes_of_a_host_get_the_very_messages_and_nothing_is_encoded_for_nobody(
    environment: Mapping[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = [Tick(k=k, t_ns=0) for k in range(100)]
    encoded: list[object] = []
    monkeypatch.setattr(codec, "encode", encoded.append)
    listener = Recorder("listener", topics.TICKS)
    clock = Recorder(SERVER, begin=lambda now_ns: [SendMessage(topics.TICKS, tick) for tick in sent])
    with hosted(environment, [listener, clock]):
        until(lambda: len(listener.got) == 100, "all are handed over")
    assert all(got is tick for got, tick in zip(listener.got, sent, strict=True))
    assert encoded == []


def test_another_process_hears_what_a_node_of_the_host_hears_in_memory_once(
    environment: Mapping[str, str], outside: Outside
) -> None:
    def pass_on(message: Message, now_ns: int) -> Iterable[Effect]:
        assert isinstance(message, Tick)
        yield SendMessage(topics.frames(topics.CLOCK), message)

    listener = Recorder("listener", topics.frames(topics.CLOCK))
    outside.hear(topics.frames(topics.CLOCK))
    with hosted(environment, [Recorder(SERVER, topics.TICKS, on=pass_on), listener]):
        for k in range(300):
            outside.put(topics.TICKS, codec.encode(Tick(k=k, t_ns=0)))
        until(lambda: len(outside.heard) == 300 and len(listener.got) >= 300, "all were passed on")
    assert listener.got == outside.heard == [Tick(k=k, t_ns=0) for k in range(300)]


def test_another_process_hears_what_must_not_be_dropped_and_a_node_of_the_host_hears_in_memory(
    environment: Mapping[str, str], outside: Outside
) -> None:
    topic = topics.replies(SERVER, "u/a")
    told = [Notice(connection="u/a", subject=str(n), body=msgspec.Raw(b"\xc0")) for n in range(100)]
    server = Recorder(SERVER, topics.TICKS, on=lambda *_: [SendMessage(topic, notice) for notice in told])
    listener = Recorder("listener", topic)
    outside.hear(topic)
    with hosted(environment, [server, listener]):
        outside.put(topics.TICKS, codec.encode(Tick(k=0, t_ns=0)))
        until(lambda: len(outside.heard) == 100 and len(listener.got) >= 100, "both hear it")
    assert listener.got == outside.heard == told


def test_answers_wait_for_the_store_and_frames_do_not(
    environment: Mapping[str, str], outside: Outside
) -> None:
    def serve(message: Message, now_ns: int) -> Iterable[Effect]:
        if isinstance(message, Tick):
            yield SendMessage(topics.frames(SERVER), ServerFrame(server=SERVER, k=message.k, fields={}))
        else:
            yield from _echo(message, now_ns)

    node = Storing(CALLS, topics.TICKS, on=serve)
    listener = Recorder("listener", topics.frames(SERVER))
    outside.hear(topics.replies(SERVER, "u/a"))
    with hosted(environment, [node, listener]):
        outside.call(plain_call("u/a", 1))
        assert node.busy.wait(20)
        for k in range(10):
            outside.put(topics.TICKS, codec.encode(Tick(k=k, t_ns=0)))
        until(lambda: len(listener.got) == 10, "frames go on")
        assert outside.heard == []
        node.go.set()
        until(lambda: bool(outside.heard), "the answer")


def test_answers_that_wait_for_a_slow_store_share_a_commit(
    environment: Mapping[str, str], outside: Outside
) -> None:
    many = 50
    node = Storing(CALLS, on=_echo)
    outside.hear(topics.replies(SERVER, "u/a"))
    with hosted(environment, [node]):
        for number in range(1, many + 1):
            outside.call(plain_call("u/a", number))
        assert node.busy.wait(20)
        until(lambda: len(node.got) == many, "all are handled")
        node.go.set()
        until(lambda: len(outside.heard) == many, "all are answered")
    assert len(node.finished) <= 5


def test_what_must_not_be_dropped_is_sent_in_a_thread_of_its_own(
    environment: Mapping[str, str], outside: Outside, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other threads go on meanwhile; when the host is stopped, what waits is sent first."""
    threads: list[str] = []
    held, let_go = threading.Event(), threading.Event()

    def answer(message: Message, now_ns: int) -> Iterable[Effect]:
        if isinstance(message, Call):
            result = msgspec.Raw(
                msgspec.msgpack.encode(bytes(MAX_DROPPABLE_BYTES if message.number > 1 else 1))
            )
            reply = Reply(connection=message.connection, number=message.number, result=result)
            yield SendMessage(topics.replies(SERVER, message.connection), reply)

    send_all = Outbox.send_all

    def waits_for_room(outbox: Outbox, sends: Sequence[SendMessage], now_ns: int) -> None:
        if outbox._may_block:
            threads.append(threading.current_thread().name)
            held.set()
            assert let_go.wait(20)
        send_all(outbox, sends, now_ns)

    monkeypatch.setattr(Outbox, "send_all", waits_for_room)
    node = Recorder(SERVER, CALLS, on=answer)
    outside.hear(topics.replies(SERVER, "u/a"))
    with Host.open(robot_address(environment), [node], serves=True) as host, running(host):
        until(lambda: SERVER in outside.network.alive(), "it is there")
        outside.call(plain_call("u/a", 2))
        assert held.wait(20)
        outside.call(plain_call("u/a", 3))
        outside.call(plain_call("u/a", 1))
        until(lambda: len(outside.heard) == 1, "a small reply overtakes the large ones")
        host.stop()
        let_go.set()
    until(lambda: len(outside.heard) == 3, "the large ones come, too")
    assert [reply.number for reply in outside.heard if isinstance(reply, Reply)] == [1, 2, 3]
    assert set(threads) == {"acknowledging"}
    assert "acknowledging" not in {thread.name for thread in threading.enumerate()}


def _stop(connection: str, number: int) -> Call:
    return msgspec.structs.replace(plain_call(connection, number, right="stop"), method=EMERGENCY_STOP)


def test_an_emergency_stop_has_a_thread_of_its_own_and_goes_before_all_that_waits(
    environment: Mapping[str, str], outside: Outside
) -> None:
    """The node is busy with a message, and hundreds wait, when the stop comes."""
    threads: list[str] = []
    node = Blocked(then=lambda: threads.append(threading.current_thread().name))
    with hosted(environment, [node]) as host:
        outside.put(topics.TICKS, codec.encode(Tick(k=0, t_ns=0)))
        assert node.busy.wait(20)
        for number in range(1, MAX_CALLS_PER_CONNECTION + 1):
            outside.call(plain_call("u/flood", number, priority=1 << 40))
        until(lambda: len(host._inbox._queue._calls) == MAX_CALLS_PER_CONNECTION, "they wait")
        stop = _stop("u/stop", 1)
        outside.call(stop)
        member = host._exchange.members[0]
        until(lambda: not member.no_stop_waits.is_set(), "the stop is next")
        node.go.set()
        until(lambda: len(node.got) == MAX_CALLS_PER_CONNECTION + 2, "all are handled")
    assert node.got[1] == stop
    assert threads[1] == "emergency stops"
    assert "emergency stops" not in {t.name for t in threading.enumerate()}


def test_a_stop_does_not_wait_for_a_node_that_is_busy_with_its_own(environment: Mapping[str, str]) -> None:
    """Both come in at once, as those of the Clock, which stores its stop, and of a base that has to halt."""
    busy, go = threading.Event(), threading.Event()

    def store(message: Message, now_ns: int) -> Iterable[Effect]:
        busy.set()
        assert go.wait(20)
        return _echo(message, now_ns)

    first, second = Recorder(SERVER, CALLS, on=store), Recorder("Light", topics.calls("Light"), on=_echo)
    with (
        hosted(environment, [first, second]),
        ZenohSession.open(robot_address(environment), server_names=("Other",)) as network,
    ):
        outside = Outside(network)
        until(lambda: {SERVER, "Light"} <= set(network.alive()), "both are linked")
        for number, topic in enumerate((CALLS, topics.calls("Light")), 1):
            stop = _stop("u/stop", number)
            key = keys.publication_key(ROBOT, topic, stop, user="u")
            outside.put(key.removeprefix(f"colony/{ROBOT}/"), codec.encode(stop))
            assert busy.wait(20)
        until(lambda: len(second.got) == 1, "the other node handles its stop")
        go.set()


def _echo(message: Message, now_ns: int) -> Iterable[Effect]:
    if isinstance(message, Call):
        reply = Reply(connection=message.connection, number=message.number)
        yield SendMessage(topics.replies(SERVER, message.connection), reply)
