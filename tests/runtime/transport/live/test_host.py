"""A process of the runtime over zenoh: what comes first, what is refused, how it ends."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor

import msgspec
import pytest

from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES
from colony.runtime.protocol.messages import (
    Alive,
    Call,
    Effect,
    Malformed,
    Message,
    Notice,
    Reply,
    SendMessage,
    Tick,
)
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.inbox import MAX_CALLS_PER_CONNECTION
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.robot_time import learned_time
from colony.runtime.transport.live.run_directory import AlreadyRunningError
from tests.kit.calling import plain_call
from tests.runtime.transport.live.outside import CALLS, SERVER, Blocked, Outside
from tests.runtime.transport.live.stage import Recorder, hosted, robot_address, running
from tests.waiting import until


def test_waiting_messages_are_taken_in_their_order(environment: Mapping[str, str], outside: Outside) -> None:
    node = Blocked()
    with hosted(environment, [node]) as host:
        outside.put(topics.TICKS, codec.encode(Tick(k=0, t_ns=0)))
        assert node.busy.wait(20)
        low, high, next_high = (
            plain_call("u/a", 1, priority=1),
            plain_call("u/b", 1, priority=5),
            plain_call("u/c", 1, priority=5),
        )
        stop, tick = plain_call("u/a", 2, priority=1, right="stop"), Tick(k=1, t_ns=0)
        for call in (low, high, next_high):
            outside.call(call)
        outside.put(topics.TICKS, codec.encode(tick))
        outside.call(stop)
        waiting = host._inbox._queue
        until(
            lambda: len(waiting._calls) == 3 and len(waiting._stops) == len(waiting._frames) == 1, "they wait"
        )
        node.go.set()
        until(lambda: len(node.got) == 6, "all are handled")
    assert node.got[1:] == [stop, tick, high, next_high, low]


def test_a_flood_is_answered_and_harms_nobody_else(environment: Mapping[str, str], outside: Outside) -> None:
    node = Blocked()
    outside.hear(topics.replies(SERVER, "u/flood"))
    with hosted(environment, [node]) as host:
        outside.put(topics.TICKS, codec.encode(Tick(k=0, t_ns=0)))
        assert node.busy.wait(20)
        outside.call(plain_call("u/other", 1))
        for number in range(1, MAX_CALLS_PER_CONNECTION + 11):
            outside.call(plain_call("u/flood", number))
        room = host._inbox._queue
        until(
            lambda: (len(room._calls), len(room._dropped_calls)) == (MAX_CALLS_PER_CONNECTION + 1, 10),
            "they wait",
        )
        node.go.set()
        until(lambda: len(node.got) == MAX_CALLS_PER_CONNECTION + 2, "all are handled")
        until(lambda: len(outside.heard) == 10, "ten are told")
    assert node.got[1] == plain_call("u/other", 1)
    replies = [reply for reply in outside.heard if isinstance(reply, Reply)]
    assert [reply.number for reply in replies] == list(
        range(MAX_CALLS_PER_CONNECTION + 1, MAX_CALLS_PER_CONNECTION + 11)
    )
    assert {reply.problem.code for reply in replies if reply.problem is not None} == {"flood"}


def test_a_host_on_another_machine_decodes_each_tick_once_and_learns_the_time_from_it(
    environment: Mapping[str, str], outside: Outside, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded: list[bytes] = []

    def count(name: str) -> None:
        original = getattr(codec, name)

        def counting(data: bytes) -> object:
            decoded.append(data)
            return original(data)

        monkeypatch.setattr(codec, name, counting)

    count("decode")
    count("decode_all")
    node = Recorder(SERVER, topics.TICKS)
    with (
        ThreadPoolExecutor() as pool,
        ZenohSession.open(robot_address(environment), server_names=(SERVER,)) as network,
    ):
        learning = pool.submit(learned_time, network)
        outside.put(topics.TICKS, codec.encode(Tick(k=0, t_ns=0)))
        learned = learning.result()
        with running(Host(network, [node], time=learned)):
            until(lambda: SERVER in outside.network.alive(), "it listens")
            hour = 3_600_000_000_000
            for k in (1, 2, 3):
                outside.put(topics.TICKS, codec.encode(Tick(k=k, t_ns=k * hour)))
            until(lambda: len(node.got) == 3, "it hears the ticks")
    assert len(decoded) == 4
    assert 3 * hour <= learned() < 4 * hour


@pytest.mark.parametrize(
    ("key", "message", "says"),
    [
        ("read/ada/7", plain_call("ada/7", 1), "claims the right to command"),
        ("command/ada/7", plain_call("bob/7", 1), "claims the connection bob/7"),
        ("command/ada/7", Tick(k=1, t_ns=1), "found Tick"),
        ("read/ada/7", Alive(connection="bob/7"), "claims the connection bob/7"),
    ],
)
def test_a_call_that_does_not_fit_its_key_is_malformed(
    environment: Mapping[str, str], outside: Outside, key: str, message: Call | Tick | Alive, says: str
) -> None:
    node = Recorder(SERVER, CALLS)
    with hosted(environment, [node]):
        outside.put(f"{CALLS}/{key}", codec.encode(message))
        until(lambda: len(node.got) == 1, "it is told of")
    malformed = node.got[0]
    assert isinstance(malformed, Malformed)
    assert malformed.connection == "ada/7"
    assert says in malformed.reason


def test_what_is_far_too_large_is_dropped_by_the_network_and_the_link_lives_on(
    environment: Mapping[str, str], outside: Outside
) -> None:
    node = Recorder(SERVER, CALLS)
    with hosted(environment, [node]):
        outside.put(f"{CALLS}/read/ada/7", bytes(3 * MAX_MESSAGE_BYTES))
        outside.call(plain_call("ada/7", 1))
        until(lambda: plain_call("ada/7", 1) in node.got, "the next call arrives")
    assert len(node.got) <= 2


def test_a_reply_that_is_too_large_becomes_an_error_and_other_messages_are_reported(
    environment: Mapping[str, str], outside: Outside
) -> None:
    huge = msgspec.Raw(msgspec.msgpack.encode(bytes(MAX_MESSAGE_BYTES)))

    def answer(message: Message, now_ns: int) -> Iterable[Effect]:
        assert isinstance(message, Call)
        topic = topics.replies(SERVER, message.connection)
        yield SendMessage(topic, Notice(connection=message.connection, subject="s", body=huge))
        yield SendMessage(topic, Reply(connection=message.connection, number=message.number, result=huge))

    reports: list[str] = []
    outside.hear(topics.replies(SERVER, "ada/7"))
    with hosted(environment, [Recorder(SERVER, CALLS, on=answer)], report=reports.append):
        outside.call(plain_call("ada/7", 3))
        until(lambda: bool(outside.heard), "an answer")
    reply = outside.heard[0]
    assert isinstance(reply, Reply)
    assert reply.number == 3
    assert reply.problem.code == "size"
    assert len(reports) == 2


def test_one_process_serves_under_a_name(environment: Mapping[str, str]) -> None:
    with (
        hosted(environment, [Recorder(SERVER), Recorder("Second")]),
        pytest.raises(AlreadyRunningError, match=r"Second of rome is already running"),
    ):
        Host.open(robot_address(environment), [Recorder("Other"), Recorder("Second")], serves=True)
    Host.open(robot_address(environment), [Recorder("Other"), Recorder("Second")], serves=True).close()


def test_a_node_that_fails_ends_the_host_and_all_are_closed(
    environment: Mapping[str, str], outside: Outside
) -> None:
    def fail(message: Message, now_ns: int) -> Iterable[Effect]:
        raise ArithmeticError("on purpose")

    nodes = [Recorder(SERVER, topics.TICKS, on=fail), Recorder("other")]
    with Host.open(robot_address(environment), nodes, serves=True) as host:
        ran = threading.Thread(target=_expect_failure, args=(host,))
        ran.start()
        outside.put(topics.TICKS, codec.encode(Tick(k=0, t_ns=0)))
        ran.join(20)
    assert [node.closed for node in nodes] == [1, 1]


def _expect_failure(host: Host) -> None:
    with pytest.raises(ArithmeticError, match="on purpose"):
        host.run()


def test_it_stops_before_it_ran(environment: Mapping[str, str]) -> None:
    node = Recorder(SERVER)
    with Host.open(robot_address(environment), [node], serves=True) as host:
        host.stop()
        host.run()
    assert node.closed == 1


def test_nodes_of_one_host_hear_each_other(environment: Mapping[str, str]) -> None:
    def send(now_ns: int) -> Iterable[Effect]:
        yield SendMessage(topics.TICKS, Tick(k=1, t_ns=now_ns))

    listener = Recorder("listener", topics.TICKS)
    with hosted(environment, [Recorder(SERVER, begin=send), listener]):
        until(lambda: len(listener.got) == 1, "the tick")


def test_the_robots_time_is_the_same_in_all_processes(environment: Mapping[str, str]) -> None:
    nodes = [Recorder(name, topics.TICKS) for name in ("one", "two")]
    hosts = [Host.open(robot_address(environment), [node]) for node in nodes]
    with (
        running(hosts[0]),
        running(hosts[1]),
        ZenohSession.open(robot_address(environment), server_names=("Clock",)) as network,
    ):
        until(lambda: len(network.alive()) == 2, "both are there")
        Outside(network).put(topics.TICKS, codec.encode(Tick(k=0, t_ns=0)))
        until(lambda: all(node.got for node in nodes), "both heard it")
    assert abs(nodes[0].times[0] - nodes[1].times[0]) < 10_000_000_000


def test_what_comes_under_the_right_to_stop_and_is_no_stop_waits_as_other_calls_do(
    environment: Mapping[str, str], outside: Outside
) -> None:
    node = Recorder(SERVER, CALLS)
    with hosted(environment, [node]):
        call = plain_call("u/a", 1, right="stop")
        outside.call(call)
        outside.put(f"{CALLS}/stop/u/a", b"nonsense")
        until(lambda: len(node.got) == 2, "both are handled")
    assert node.got[0] == call
    assert isinstance(node.got[1], Malformed)


def test_a_frame_that_cannot_be_yet_is_malformed(environment: Mapping[str, str], outside: Outside) -> None:
    node = Recorder(SERVER, topics.TICKS)
    with hosted(environment, [node]):
        outside.put(topics.TICKS, codec.encode(Tick(k=1 << 62, t_ns=0)))
        outside.put(topics.TICKS, codec.encode(Tick(k=1, t_ns=0)))
        until(lambda: len(node.got) == 2, "both are handled")
    assert isinstance(node.got[0], Malformed)
    assert node.got[1] == Tick(k=1, t_ns=0)
