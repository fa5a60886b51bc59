"""Messages that a node is in no hurry for wait outside of it, up to so many of a topic; what is dropped
beyond is asked for again, as anything that got lost."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Mapping

import msgspec
import pytest
import zenoh

from colony.runtime.frames.assembler import FrameAssembler
from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.bindings import SensorBinding
from colony.runtime.protocol.calls import EMERGENCY_STOP
from colony.runtime.protocol.messages import (
    Effect,
    Fetch,
    Message,
    Request,
    Sample,
    Send,
    ServerFrame,
    Tick,
)
from colony.runtime.transport.live import deferred, keys, rate_limits
from colony.runtime.transport.live.deferred import DEFERRED_BATCH
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.meter import Rate
from tests.kit.calling import plain_call
from tests.runtime.transport.live.outside import SERVER, Outside
from tests.runtime.transport.live.stage import ROBOT, Recorder, hosted, robot_address, running
from tests.waiting import until

SONAR = SensorBinding(sensor="sonar", server="PServer", field="sonar", max_age_ns=None)
FRAMES = topics.frames("PServer")
REQUESTS = topics.requests("PServer")
RING = 8


def tick(k: int) -> Tick:
    return Tick(k=k, t_ns=k, run="run")


def frame(k: int) -> ServerFrame:
    return ServerFrame(server="PServer", k=k, fields={"sonar": Sample(float(k), k)})


class Reader:
    """Puts frames together, and is in no hurry for them. Mutable: what it got, what it asked for.

    It handles tick 0 for as long as `go` is not set.
    """

    address = SERVER
    listens = (topics.TICKS, FRAMES, REQUESTS)
    deferred = (FRAMES, REQUESTS)

    def __init__(self) -> None:
        self._assembler = FrameAssembler((SONAR,), run="run", frames_kept=1000)
        self.busy, self.go = threading.Event(), threading.Event()
        self.heard: list[Message] = []
        self.got: list[tuple[int, object]] = []
        self.asked: list[int] = []

    def start(self, now_ns: int) -> Iterable[Effect]:
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        self.heard.append(message)
        if isinstance(message, (Tick, ServerFrame)):
            for effect in self._assembler.take(message):
                assert isinstance(effect, Send)
                assert isinstance(effect.message, Fetch)
                self.asked.append(effect.message.k)
                yield effect
            self.got += [(a.tick.k, a.frame.readings["sonar"]) for a in self._assembler.pop_complete()]
            if message == tick(0):
                self.busy.set()
                assert self.go.wait(20)

    def close(self) -> None:
        """It holds nothing."""


@pytest.fixture
def reader(monkeypatch: pytest.MonkeyPatch) -> Reader:
    monkeypatch.setattr(deferred, "MAX_DEFERRED_FRAMES", RING)
    return Reader()


def put(outside: Outside, *messages: Tick | ServerFrame) -> None:
    for message in messages:
        outside.put(topics.TICKS if isinstance(message, Tick) else FRAMES, codec.encode(message))


def over_a_slow(reader: Reader, host: Host, outside: Outside, frames: int) -> None:
    """Frames 0 to `frames` - 1 come while it is busy with the tick of the first."""
    arrived: list[bytes] = []
    noting = zenoh.handlers.Callback(lambda sample: arrived.append(sample.payload.to_bytes()), indirect=False)
    host.network.session.declare_subscriber(keys.subscription_key(ROBOT, topics.TICKS), noting)
    put(outside, tick(0))
    assert reader.busy.wait(20)
    for k in range(frames):
        put(outside, *([tick(k)] if k else []), frame(k))
    last = tick(frames)  # behind all others
    put(outside, last)
    until(lambda: codec.encode(last) in arrived, "all are there")
    reader.go.set()
    until(lambda: tick(frames) in reader.heard, "all ticks are heard")


def test_as_many_as_there_is_room_for_wait_for_a_slow_node_and_none_is_lost(
    environment: Mapping[str, str], outside: Outside, reader: Reader
) -> None:
    with hosted(environment, [reader]) as host:
        over_a_slow(reader, host, outside, RING)
        until(lambda: len(reader.got) == RING, "all frames are put together")
    assert reader.got == [(k, float(k)) for k in range(RING)]
    assert reader.asked == []


def test_of_more_the_oldest_are_dropped_and_asked_for_again(
    environment: Mapping[str, str], outside: Outside, reader: Reader
) -> None:
    more = 5
    outside.hear(topics.fetches("PServer"))
    with hosted(environment, [reader]) as host:
        over_a_slow(reader, host, outside, RING + more)
        until(lambda: set(reader.asked) == set(range(more)), "they are asked for")
        until(lambda: len(outside.heard) == len(reader.asked), "and this is heard")
        put(outside, *(frame(k) for k in range(more)), tick(RING + more + 1))
        until(lambda: len(reader.got) == RING + more, "all frames are put together")
        until(lambda: len(outside.heard) == len(reader.asked), "and all that was asked for is heard")
    assert outside.heard == [Fetch(server="PServer", k=k) for k in reader.asked]
    assert reader.got == [(k, float(k)) for k in range(RING + more)]


@pytest.mark.parametrize("direct", [False, True])
def test_they_are_handled_before_the_message_that_they_waited_for(
    environment: Mapping[str, str], outside: Outside, reader: Reader, direct: bool
) -> None:
    reader.go.set()
    with (
        Host.open(robot_address(environment), [reader], serves=True, handle_directly=direct) as host,
        running(host),
    ):
        until(lambda: reader.address in outside.network.alive(), "it is there")
        put(outside, frame(0), frame(1), tick(0))
        until(lambda: tick(0) in reader.heard, "the tick is heard")
    assert reader.heard == [frame(0), frame(1), tick(0)]


def test_where_another_node_of_the_process_is_in_a_hurry_nobody_waits(
    environment: Mapping[str, str], outside: Outside, reader: Reader
) -> None:
    with hosted(environment, [reader, Recorder("Hasty", FRAMES)]):
        put(outside, frame(0))
        until(lambda: frame(0) in reader.heard, "it is heard without a tick")


@pytest.mark.parametrize("direct", [False, True])
def test_what_users_send_waits_too_and_is_counted(
    environment: Mapping[str, str],
    outside: Outside,
    reader: Reader,
    monkeypatch: pytest.MonkeyPatch,
    direct: bool,
) -> None:
    monkeypatch.setattr(rate_limits, "PROGRAM_RATE", Rate(per_s=0.0, burst=2.0))
    reader.go.set()
    requests = [Request(k=k, actuator="drive", client="c", bid="silent") for k in range(3)]
    with (
        Host.open(robot_address(environment), [reader], serves=True, handle_directly=direct) as host,
        running(host),
    ):
        until(lambda: reader.address in outside.network.alive(), "it is there")
        for request in requests:
            outside.put(f"{REQUESTS}/ada", codec.encode(request))
        put(outside, tick(0))
        until(lambda: tick(0) in reader.heard, "the tick is heard")
    assert reader.heard == [*requests[:2], tick(0)]


class Stoppable(Recorder):
    """Is in no hurry for frames; handles the first one for as long as `go` is not set."""

    deferred = (FRAMES,)

    def __init__(self) -> None:
        super().__init__(SERVER, topics.calls(SERVER), topics.TICKS, FRAMES)
        self.busy, self.go = threading.Event(), threading.Event()

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        if message == frame(0):
            self.busy.set()
            assert self.go.wait(20)
        return super().handle(message, now_ns)


def test_an_emergency_stop_waits_for_none_of_them(environment: Mapping[str, str], outside: Outside) -> None:
    node = Stoppable()
    stop = msgspec.structs.replace(plain_call("u/a", 1, right="stop"), method=EMERGENCY_STOP)
    with hosted(environment, [node]) as host:
        put(outside, *map(frame, range(5 * DEFERRED_BATCH)), tick(0))
        assert node.busy.wait(20)
        outside.call(stop)
        until(lambda: not host._no_stop_pending.is_set(), "the stop is there")
        node.go.set()
        until(lambda: tick(0) in node.got, "the tick is handled")
    assert node.got[:2] == [frame(0), stop]
