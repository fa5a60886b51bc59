"""In which thread a host handles what: frames where they come in, emergency stops before all else."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping

import msgspec

from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.calls import EMERGENCY_STOP
from colony.runtime.protocol.messages import (
    Call,
    Effect,
    Message,
    Reply,
    Send,
    SentMessage,
    Tick,
    Wake,
    WakeAt,
)
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.message_queue import MAX_CALLS_PER_CONNECTION
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.outbox import declare_publisher
from colony.runtime.transport.live.sender import MAX_DROPPABLE_BYTES
from tests.kit.calling import plain_call
from tests.runtime.transport.live.outside import CALLS, SERVER, Blocked, Outside
from tests.runtime.transport.live.stage import ROBOT, Recorder, hosted, robot_address, running
from tests.waiting import until


class _Threads(Recorder):
    """Notes in which threads it handles what."""

    def __init__(self, *listens: str, on: Callable[[Message, int], Iterable[Effect]]) -> None:
        super().__init__(SERVER, *listens, on=on)
        self.threads: list[int] = []

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        self.threads.append(threading.get_ident())
        return super().handle(message, now_ns)


def test_a_direct_host_handles_frames_and_calls_where_they_come_in_and_wakes_in_its_own_thread(
    environment: Mapping[str, str], outside: Outside
) -> None:
    def wake(message: Message, now_ns: int) -> Iterable[Effect]:
        if isinstance(message, Tick):
            yield WakeAt(now_ns + 1_000_000)

    node = _Threads(CALLS, topics.TICKS, on=wake)
    with (
        Host.open(robot_address(environment), [node], serves=True, handle_directly=True) as host,
        running(host) as run,
    ):
        until(lambda: SERVER in outside.network.alive(), "it is there")
        outside.put(topics.TICKS, codec.encode(Tick(k=0, t_ns=0)))
        until(lambda: len(node.got) == 2, "the tick and the wake")
        outside.call(plain_call("u/a", 1))
        until(lambda: len(node.got) == 3, "the call")
        own = run.thread.ident
    assert [type(message) for message in node.got] == [Tick, Wake, Call]
    assert [thread == own for thread in node.threads] == [False, True, False]


def test_a_direct_host_loses_nothing_and_keeps_the_order_while_calls_come_between(
    environment: Mapping[str, str], outside: Outside
) -> None:
    many = 300
    node = Recorder(SERVER, CALLS, topics.TICKS)
    second = Recorder("Second", topics.TICKS)
    with (
        Host.open(robot_address(environment), [node, second], serves=True, handle_directly=True) as host,
        running(host),
    ):
        until(lambda: SERVER in outside.network.alive(), "it is there")
        for k in range(many):
            outside.put(topics.TICKS, codec.encode(Tick(k=k, t_ns=0)))
            if k % 3 == 0:
                outside.call(plain_call("u/a", 1 + k))
        until(lambda: len(node.got) == many + many // 3, "all are handled")
    assert [message.k for message in second.got if isinstance(message, Tick)] == [*range(many)]
    assert [message.k for message in node.got if isinstance(message, Tick)] == [*range(many)]


def test_nodes_of_a_direct_host_hear_each_other(environment: Mapping[str, str], outside: Outside) -> None:
    def pass_on(message: Message, now_ns: int) -> Iterable[Effect]:
        assert isinstance(message, Tick)
        yield Send(topics.frames(topics.CLOCK), message)

    nodes = [
        Recorder(SERVER, topics.TICKS, on=pass_on),
        Recorder("listener", topics.frames(topics.CLOCK)),
    ]
    with (
        Host.open(robot_address(environment), nodes, serves=True, handle_directly=True) as host,
        running(host),
    ):
        until(lambda: SERVER in outside.network.alive(), "it is there")
        for k in range(100):
            outside.put(topics.TICKS, codec.encode(Tick(k=k, t_ns=0)))
        until(lambda: len(nodes[1].got) == 100, "all were passed on")
    assert nodes[1].got == nodes[0].got


def test_a_direct_host_sends_what_must_not_be_dropped_in_a_thread_of_its_own(
    environment: Mapping[str, str], outside: Outside
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
            yield Send(topics.replies(SERVER, message.connection), reply)

    node = Recorder(SERVER, CALLS, on=answer)
    outside.hear(topics.replies(SERVER, "u/a"))
    with Host.open(robot_address(environment), [node], serves=True, handle_directly=True) as host:
        send_all = host._blocking_outbox.send_all

        def waits_for_room(sends: Iterable[Send], now_ns: int) -> None:
            threads.append(threading.current_thread().name)
            held.set()
            assert let_go.wait(20)
            send_all(sends, now_ns)

        host._blocking_outbox.send_all = waits_for_room  # type: ignore[method-assign]
        with running(host):
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
    assert threads == ["large messages"] * 2
    assert "large messages" not in {thread.name for thread in threading.enumerate()}


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
        until(lambda: not host._no_stop_pending.is_set(), "the stop is next")
        node.go.set()
        until(lambda: len(node.got) == MAX_CALLS_PER_CONNECTION + 2, "all are handled")
    assert node.got[1] == stop
    assert threads[1] == "emergency stops"
    assert "emergency stops" not in {t.name for t in threading.enumerate()}


def test_the_stops_of_all_nodes_of_a_process_are_handled_and_answered_in_one_thread(
    environment: Mapping[str, str], outside: Outside
) -> None:
    threads: list[int] = []

    def note(message: Message, now_ns: int) -> Iterable[Effect]:
        threads.append(threading.get_ident())
        return _echo(message, now_ns)

    topics_of_calls = CALLS, topics.calls("Light"), topics.calls("Panel")
    nodes = [Recorder(topic.partition("/")[0], topic, on=note) for topic in topics_of_calls]
    with hosted(environment, nodes) as host:
        send_all = host._stop_outbox.send_all

        def noted(sends: Iterable[Send], now_ns: int) -> None:
            threads.append(threading.get_ident())
            send_all(sends, now_ns)

        host._stop_outbox.send_all = noted  # type: ignore[method-assign]
        for number, topic in enumerate(topics_of_calls, 1):
            stop = _stop("u/stop", number)
            key = keys.publication_key(ROBOT, topic, stop, user="u")
            outside.put(key.removeprefix(f"colony/{ROBOT}/"), codec.encode(stop))
        until(lambda: len(threads) == 2 * len(nodes), "all are handled and answered")
    assert len(set(threads)) == 1


def test_an_answer_that_nobody_takes_does_not_hold_up_a_stop(environment: Mapping[str, str]) -> None:
    """The thread that sends waits for room, which another process does not make."""
    sending, go_on = threading.Event(), threading.Event()
    node = Recorder(SERVER, CALLS, on=_echo)
    with hosted(environment, [node]) as host, ZenohSession.open(robot_address(environment)) as network:
        send = host._outbox.send

        def blocked(topic: str, message: SentMessage, now_ns: int) -> None:
            sending.set()
            assert go_on.wait(20)
            send(topic, message, now_ns)

        host._outbox.send = blocked  # type: ignore[method-assign]
        for number, call in enumerate((plain_call("u/a", 1), _stop("u/a", 2))):
            key = keys.publication_key(ROBOT, CALLS, call, user="u")
            with declare_publisher(network.session, key) as publisher:
                until(lambda p=publisher: p.matching_status.matching, "the server listens")  # type: ignore[misc]
                publisher.put(codec.encode(call))
            until(lambda n=number: len(node.got) > n, "it is handled")  # type: ignore[misc]
            assert sending.wait(20)
        go_on.set()


def _echo(message: Message, now_ns: int) -> Iterable[Effect]:
    if isinstance(message, Call):
        reply = Reply(connection=message.connection, number=message.number)
        yield Send(topics.replies(SERVER, message.connection), reply)
