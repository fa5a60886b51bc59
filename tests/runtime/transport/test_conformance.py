"""What every transport promises its nodes: the same nodes and scenarios in virtual time and over zenoh."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from typing import Protocol

import msgspec
import pytest

from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES, MessageFormatError
from colony.runtime.protocol.messages import (
    Alive,
    Call,
    Effect,
    Malformed,
    Message,
    Node,
    Reply,
    SendMessage,
    SentMessage,
    ServerFrame,
    Tick,
    Wake,
    WakeAt,
)
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.outbox import declare_publisher
from colony.runtime.transport.virtual import VirtualClock, VirtualTransport
from tests.runtime.transport.live.stage import Recorder, Running, robot_address, run_directory
from tests.waiting import until

ELSEWHERE = topics.frames(topics.CLOCK)
"""Another topic of ticks."""

SECOND = 1_000_000_000


class Stage(Protocol):
    """A transport under test."""

    def add(self, node: Node) -> None: ...

    def kill(self, address: str) -> None: ...

    def tell(self, topic: str, message: SentMessage) -> None:
        """Send from outside."""
        ...

    def throw(self, topic: str, data: bytes, connection: str | None = None) -> None:
        """Send bytes that need not be a message; to a topic of calls, as this connection."""
        ...

    def until(self, condition: Callable[[], bool]) -> None:
        """Let things happen until `condition` holds."""
        ...


class VirtualStage:
    """In one process and virtual time."""

    def __init__(self) -> None:
        self._clock = VirtualClock()
        self._transport = VirtualTransport(self._clock, seed=1)

    def add(self, node: Node) -> None:
        self._transport.add(node)

    def kill(self, address: str) -> None:
        self._transport.kill(address).close()

    def tell(self, topic: str, message: SentMessage) -> None:
        self._transport.inject(topic, message)

    def throw(self, topic: str, data: bytes, connection: str | None = None) -> None:
        message: Message
        try:
            message = codec.decode(data)
        except MessageFormatError as problem:
            message = Malformed(topic=topic, connection=connection, reason=str(problem))
        self._transport.inject(topic, message)

    def until(self, condition: Callable[[], bool]) -> None:
        end = self._clock.now_ns + 60 * SECOND
        while not condition():
            assert self._clock.now_ns < end, "waited in vain"
            self._transport.run_until(self._clock.now_ns + SECOND // 1000)

    def close(self) -> None:
        for address in self._transport.addresses:
            self.kill(address)


class LiveStage:
    """Over zenoh: a host for every node, each with a session and a socket of its own."""

    def __init__(self) -> None:
        self._holds = ExitStack()
        self._environment = self._holds.enter_context(run_directory())
        self._hosts: dict[str, Running] = {}
        here = robot_address(self._environment)
        self._outside = self._holds.enter_context(ZenohSession.open(here, server_names=(topics.CLOCK,)))

    def add(self, node: Node) -> None:
        host = Host.open(robot_address(self._environment), [node], serves=True)
        self._hosts[node.address] = Running(host)
        networks = [self._outside, *(running.host.network for running in self._hosts.values())]
        for network in networks:
            until(lambda n=network: self._sees_all(n), "not all are linked")  # type: ignore[misc]

    def _sees_all(self, network: ZenohSession) -> bool:
        return set(self._hosts) <= set(network.alive())

    def kill(self, address: str) -> None:
        self._hosts.pop(address).end()

    def tell(self, topic: str, message: SentMessage) -> None:
        self._put(keys.publication_key("rome", topic, message, user="ada"), codec.encode(message))

    def throw(self, topic: str, data: bytes, connection: str | None = None) -> None:
        ending = f"/command/{connection}" if connection is not None else ""
        key = f"colony/rome/{topic}" + ("/ada" if keys.user_message_kind(topic) else ending)
        self._put(key, data)

    def _put(self, key: str, data: bytes) -> None:
        with declare_publisher(self._outside.session, key) as publisher:
            until(lambda: publisher.matching_status.matching, f"nobody listens to {key}")  # type: ignore[attr-defined]
            publisher.put(data)

    def until(self, condition: Callable[[], bool]) -> None:
        until(condition, "the scenario")

    def close(self) -> None:
        for address in tuple(self._hosts):
            self.kill(address)
        self._holds.close()


class ComposedStage(LiveStage):
    """Over zenoh: all nodes in one host, which hands their messages over in memory."""

    def __init__(self) -> None:
        super().__init__()
        self._running = Running(Host.open(robot_address(self._environment), [Recorder("first")], serves=True))
        self._composed = self._running.host
        self._addresses: set[str] = set()

    def add(self, node: Node) -> None:
        self._composed.add([node])
        self._addresses.add(node.address)
        until(lambda: self._composed._exchange.member(node.address) is not None, "it does not start")
        until(lambda: self._addresses <= set(self._outside.alive()), "not all are linked")

    def kill(self, address: str) -> None:
        self._composed._exchange.remove(address).close()

    def close(self) -> None:
        self._running.end()
        self._holds.close()


@pytest.fixture(params=[VirtualStage, LiveStage, ComposedStage], ids=["virtual", "live", "composed"])
def stage(request: pytest.FixtureRequest) -> Iterator[Stage]:
    made = request.param()
    try:
        yield made
    finally:
        made.close()


def _ticks(node: Recorder) -> list[int]:
    return [message.k for message in node.got if isinstance(message, Tick)]


def test_a_message_goes_to_all_who_listen_and_to_nobody_else(stage: Stage) -> None:
    one, two = Recorder("one", topics.TICKS), Recorder("two", topics.TICKS, topics.VERDICTS)
    other = Recorder("other", topics.READY)
    for node in (one, two, other):
        stage.add(node)
    stage.tell(topics.TICKS, Tick(k=3, t_ns=7))
    stage.until(lambda: bool(one.got) and bool(two.got))
    assert one.got == two.got == [Tick(k=3, t_ns=7)]
    assert other.got == []


def test_a_topic_listed_twice_is_heard_once(stage: Stage) -> None:
    node = Recorder("node", topics.TICKS, topics.TICKS)
    stage.add(node)
    stage.tell(topics.TICKS, Tick(k=1, t_ns=0))
    stage.tell(topics.TICKS, Tick(k=2, t_ns=0))
    stage.until(lambda: len(node.got) >= 2)
    assert sorted(_ticks(node)) == [1, 2]


def test_every_kind_of_value_arrives_as_it_was_sent(stage: Stage) -> None:
    node = Recorder("node", topics.frames("DServer"))
    stage.add(node)
    fields = {"a": (0.1, 5), "b": (True, 6), "c": ((1.0, 2.5), 7), "d": None}
    sent = msgspec.convert(["ServerFrame", "DServer", 4, fields, 2], ServerFrame)
    stage.tell(topics.frames("DServer"), sent)
    stage.until(lambda: bool(node.got))
    assert node.got == [sent]


def test_what_one_sender_sends_later_arrives_later(stage: Stage) -> None:
    many = 200

    def count(message: Message, now_ns: int) -> Iterable[Effect]:
        if len(sender.got) <= many:
            yield SendMessage(ELSEWHERE, Tick(k=len(sender.got), t_ns=now_ns))
            yield WakeAt(now_ns + 1000)

    listener = Recorder("listener", ELSEWHERE)
    sender = Recorder("sender", topics.TICKS, on=count)
    stage.add(listener)
    stage.add(sender)
    stage.tell(topics.TICKS, Tick(k=0, t_ns=0))
    stage.until(lambda: len(listener.got) >= many)
    assert _ticks(listener) == list(range(1, many + 1))


def test_a_wake_comes_not_before_its_time(stage: Stage) -> None:
    due: list[int] = []

    def begin(now_ns: int) -> Iterable[Effect]:
        due.extend((now_ns - 1, now_ns + 3_000_000, now_ns + 6_000_000))
        return [WakeAt(t_ns) for t_ns in reversed(due)]

    node = Recorder("node", begin=begin)
    stage.add(node)
    stage.until(lambda: len(node.got) == 3)
    assert node.got == [Wake()] * 3
    assert all(came >= t for came, t in zip(node.times, due, strict=True))
    assert node.times == sorted(node.times)


def test_one_node_takes_the_place_of_another(stage: Stage) -> None:
    old, new = Recorder("node", topics.TICKS), Recorder("node", topics.TICKS)
    stage.add(old)
    stage.tell(topics.TICKS, Tick(k=1, t_ns=0))
    stage.until(lambda: _ticks(old) == [1])
    stage.kill("node")
    assert old.closed == 1
    stage.add(new)
    stage.tell(topics.TICKS, Tick(k=2, t_ns=0))
    stage.until(lambda: _ticks(new) == [2])
    assert _ticks(old) == [1]


@pytest.mark.parametrize(
    "data",
    [b"", b"\x02", b"\x01", b"\x01\xc1", b"\x01\x91\xa4Nope", codec.encode(Tick(k=1, t_ns=1))[:-1]],
    ids=["nothing", "another version", "no message", "no msgpack", "unknown", "cut off"],
)
def test_bytes_that_are_no_message_are_told_of_and_do_no_harm(stage: Stage, data: bytes) -> None:
    node = Recorder("node", topics.TICKS)
    stage.add(node)
    stage.throw(topics.TICKS, data)
    stage.until(lambda: len(node.got) == 1)
    stage.tell(topics.TICKS, Tick(k=1, t_ns=2))
    stage.until(lambda: len(node.got) == 2)
    malformed, good = node.got
    assert isinstance(malformed, Malformed)
    assert (malformed.topic, malformed.connection) == (topics.TICKS, None)
    assert good == Tick(k=1, t_ns=2)


def test_a_malformed_call_is_told_of_with_whose_it_was(stage: Stage) -> None:
    node = Recorder("node", topics.calls("node"))
    stage.add(node)
    stage.throw(topics.calls("node"), b"\x01junk", "ada/7")
    stage.until(lambda: len(node.got) == 1)
    malformed = node.got[0]
    assert isinstance(malformed, Malformed)
    assert (malformed.topic, malformed.connection) == (topics.calls("node"), "ada/7")


def test_the_largest_message_arrives_and_a_larger_one_is_malformed(stage: Stage) -> None:
    node = Recorder("node", topics.calls("node"))
    stage.add(node)
    empty = len(codec.encode(_call(b"", 1)))
    largest = _call(b"x" * (MAX_MESSAGE_BYTES - empty - 4), 1)
    assert MAX_MESSAGE_BYTES - 8 <= len(codec.encode(largest)) <= MAX_MESSAGE_BYTES
    stage.tell(topics.calls("node"), largest)
    stage.until(lambda: len(node.got) == 1)
    assert node.got == [largest]
    stage.throw(topics.calls("node"), codec.encode(largest) + b"x" * 8, "ada/7")
    stage.until(lambda: len(node.got) == 2)
    malformed = node.got[1]
    assert isinstance(malformed, Malformed)
    assert str(MAX_MESSAGE_BYTES) in malformed.reason
    stage.tell(topics.calls("node"), _call(b"", 2))
    stage.until(lambda: len(node.got) == 3)


class _Settler(Recorder):
    """Its answers may leave only after it settled."""

    unsettled = True

    def __init__(self, *listens: str, on: Callable[[Message, int], Iterable[Effect]]) -> None:
        super().__init__("settler", *listens, on=on)
        self.settled = 0

    def settle(self) -> Callable[[], None]:
        handled = len(self.got)

        def finish() -> None:
            self.settled = handled

        return finish


def test_a_node_settles_before_its_answers_leave(stage: Stage) -> None:
    def answer(message: Message, now_ns: int) -> Iterable[Effect]:
        if isinstance(message, Tick):
            yield SendMessage(topics.replies("settler", "ada/1"), Reply(connection="ada/1", number=message.k))

    settler = _Settler(topics.TICKS, on=answer)
    settled_at: list[tuple[int, int]] = []

    def note(message: Message, now_ns: int) -> Iterable[Effect]:
        assert isinstance(message, Reply)
        settled_at.append((message.number, settler.settled))
        return ()

    stage.add(Recorder("listener", topics.replies("settler", "ada/1"), on=note))
    stage.add(settler)
    for k in range(1, 6):
        stage.tell(topics.TICKS, Tick(k=k, t_ns=0))
    stage.until(lambda: len(settled_at) == 5)
    places = {k: robot_address for robot_address, k in enumerate(_ticks(settler), start=1)}
    assert all(settled >= places[k] for k, settled in settled_at)


def test_calls_and_replies_find_their_ways(stage: Stage) -> None:
    def answer(message: Message, now_ns: int) -> Iterable[Effect]:
        if isinstance(message, Call):
            reply = Reply(connection=message.connection, number=message.number)
            yield SendMessage(topics.replies("server", message.connection), reply)

    mine, yours = (Recorder(name, topics.replies("server", f"ada/{name}")) for name in ("mine", "yours"))
    server = Recorder("server", topics.calls("server"), on=answer)
    for node in (server, mine, yours):
        stage.add(node)
    call = Call(connection="ada/mine", number=1, method="m", arguments=msgspec.Raw(b"\xc0"), right="read")
    stage.tell(topics.calls("server"), call)
    stage.until(lambda: bool(mine.got))
    stage.tell(topics.calls("server"), Alive(connection="ada/mine"))
    stage.until(lambda: len(server.got) == 2)
    assert server.got == [call, Alive(connection="ada/mine")]
    assert mine.got == [Reply(connection="ada/mine", number=1)]
    assert yours.got == []


def _call(data: bytes, number: int) -> Call:
    arguments = msgspec.Raw(msgspec.msgpack.encode(data))
    return Call(connection="ada/7", number=number, method="m", arguments=arguments)
