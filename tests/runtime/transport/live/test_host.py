"""A process of the runtime over zenoh: what comes first, what is refused, how it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

import msgspec
import pytest

from colony.runtime.assembly.processes.children import ONE_THREAD
from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.calls import EMERGENCY_STOP
from colony.runtime.protocol.codec import LARGEST
from colony.runtime.protocol.messages import (
    Alive,
    Call,
    Effect,
    Malformed,
    Message,
    Notice,
    Reply,
    Sample,
    Send,
    Sent,
    ServerFrame,
    Tick,
    Wake,
    WakeAt,
)
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.configuration import BLOCKED_US
from colony.runtime.transport.live.errors import AlreadyRunning
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.network import Network
from colony.runtime.transport.live.outbox import publish
from colony.runtime.transport.live.waiting import CALLS_EACH
from tests.runtime.calling import plain_call
from tests.runtime.transport.live.stage import ROBOT, Recorder, hosted, place, run_directory, running, until

SERVER = "RServer"
CALLS = topics.calls(SERVER)


@pytest.fixture
def environment() -> Iterator[Mapping[str, str]]:
    with run_directory() as made:
        yield made


class _Outside:
    """Somebody who sends bytes and hears replies."""

    def __init__(self, network: Network) -> None:
        self.network = network
        self.heard: list[object] = []

    def put(self, key: str, data: bytes) -> None:
        with publish(self.network.session, f"colony/{ROBOT}/{key}") as publisher:
            until(lambda: publisher.matching_status.matching, f"nobody listens to {key}")  # type: ignore[attr-defined]
            publisher.put(data)

    def call(self, call: Call) -> None:
        self.put(
            keys.sending(ROBOT, CALLS, call, user="ada").removeprefix(f"colony/{ROBOT}/"), codec.encode(call)
        )

    def hear(self, topic: str) -> None:
        import zenoh

        handler = zenoh.handlers.Callback(self._take, indirect=False)
        self.network.session.declare_subscriber(keys.listening(ROBOT, topic), handler)

    def _take(self, sample: object) -> None:
        self.heard.append(codec.decode(sample.payload.to_bytes()))  # type: ignore[attr-defined]


@pytest.fixture
def outside(environment: Mapping[str, str]) -> Iterator[_Outside]:
    with Network.open(place(environment)) as network:
        yield _Outside(network)


class _Blocked(Recorder):
    """Handles a first tick for as long as `go` is not set; meanwhile others wait."""

    def __init__(self, then: Callable[[], None] = lambda: None) -> None:
        super().__init__(SERVER, CALLS, topics.TICKS, on=self._block)
        self.busy, self.go = threading.Event(), threading.Event()
        self._then = then

    def _block(self, message: Message, now_ns: int) -> Iterable[Effect]:
        self._then()
        if len(self.got) == 1:
            self.busy.set()
            assert self.go.wait(20)
        return ()


def test_waiting_messages_are_taken_in_their_order(environment: Mapping[str, str], outside: _Outside) -> None:
    node = _Blocked()
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
        waiting = host._inbox._room
        until(
            lambda: len(waiting._calls) == 3 and len(waiting._stops) == len(waiting._frames) == 1, "they wait"
        )
        node.go.set()
        until(lambda: len(node.got) == 6, "all are handled")
    assert node.got[1:] == [stop, tick, high, next_high, low]


def test_a_flood_is_answered_and_harms_nobody_else(environment: Mapping[str, str], outside: _Outside) -> None:
    node = _Blocked()
    outside.hear(topics.replies(SERVER, "u/flood"))
    with hosted(environment, [node]) as host:
        outside.put(topics.TICKS, codec.encode(Tick(k=0, t_ns=0)))
        assert node.busy.wait(20)
        outside.call(plain_call("u/other", 1))
        for number in range(1, CALLS_EACH + 11):
            outside.call(plain_call("u/flood", number))
        room = host._inbox._room
        until(lambda: (len(room._calls), len(room._given_up)) == (CALLS_EACH + 1, 10), "they wait")
        node.go.set()
        until(lambda: len(node.got) == CALLS_EACH + 2, "all are handled")
        until(lambda: len(outside.heard) == 10, "ten are told")
    assert node.got[1] == plain_call("u/other", 1)
    replies = [reply for reply in outside.heard if isinstance(reply, Reply)]
    assert [reply.number for reply in replies] == list(range(CALLS_EACH + 1, CALLS_EACH + 11))
    assert {reply.problem.code for reply in replies if reply.problem is not None} == {"flood"}


@pytest.mark.parametrize(
    ("key", "message", "says"),
    [
        ("read/ada/7", plain_call("ada/7", 1), "claims the right to command"),
        ("command/ada/7", plain_call("bob/7", 1), "claims to be of bob/7"),
        ("command/ada/7", Tick(k=1, t_ns=1), "found Tick"),
        ("read/ada/7", Alive(connection="bob/7"), "claims to be of bob/7"),
    ],
)
def test_a_call_that_does_not_fit_its_key_is_malformed(
    environment: Mapping[str, str], outside: _Outside, key: str, message: Call | Tick | Alive, says: str
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
    environment: Mapping[str, str], outside: _Outside
) -> None:
    node = Recorder(SERVER, CALLS)
    with hosted(environment, [node]):
        outside.put(f"{CALLS}/read/ada/7", bytes(3 * LARGEST))
        outside.call(plain_call("ada/7", 1))
        until(lambda: plain_call("ada/7", 1) in node.got, "the next call arrives")
    assert len(node.got) <= 2


def test_a_reply_that_is_too_large_becomes_an_error_and_other_messages_are_reported(
    environment: Mapping[str, str], outside: _Outside
) -> None:
    huge = msgspec.Raw(msgspec.msgpack.encode(bytes(LARGEST)))

    def answer(message: Message, now_ns: int) -> Iterable[Effect]:
        assert isinstance(message, Call)
        topic = topics.replies(SERVER, message.connection)
        yield Send(topic, Notice(connection=message.connection, subject="s", body=huge))
        yield Send(topic, Reply(connection=message.connection, number=message.number, result=huge))

    reports: list[str] = []
    outside.hear(topics.replies(SERVER, "ada/7"))
    with hosted(environment, [Recorder(SERVER, CALLS, on=answer)], report=reports.append):
        outside.call(plain_call("ada/7", 3))
        until(lambda: bool(outside.heard), "an answer")
    reply = outside.heard[0]
    assert isinstance(reply, Reply)
    assert reply.number == 3
    assert reply.problem is not None
    assert reply.problem.code == "size"
    assert len(reports) == 2


def test_one_process_serves_under_a_name(environment: Mapping[str, str]) -> None:
    with (
        hosted(environment, [Recorder(SERVER), Recorder("Second")]),
        pytest.raises(AlreadyRunning, match=r"Second of rome runs already"),
    ):
        Host.open(place(environment), [Recorder("Other"), Recorder("Second")], serves=True)
    Host.open(place(environment), [Recorder("Other"), Recorder("Second")], serves=True).close()


@pytest.mark.parametrize("direct", [False, True])
def test_a_node_that_fails_ends_the_host_and_all_are_closed(
    environment: Mapping[str, str], outside: _Outside, direct: bool
) -> None:
    def fail(message: Message, now_ns: int) -> Iterable[Effect]:
        raise ArithmeticError("on purpose")

    nodes = [Recorder(SERVER, topics.TICKS, on=fail), Recorder("other")]
    with Host.open(place(environment), nodes, serves=True, direct=direct) as host:
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
    with Host.open(place(environment), [node], serves=True) as host:
        host.stop()
        host.run()
    assert node.closed == 1


def test_nodes_of_one_host_hear_each_other(environment: Mapping[str, str]) -> None:
    def send(now_ns: int) -> Iterable[Effect]:
        yield Send(topics.TICKS, Tick(k=1, t_ns=now_ns))

    listener = Recorder("listener", topics.TICKS)
    with hosted(environment, [Recorder(SERVER, begin=send), listener]):
        until(lambda: len(listener.got) == 1, "the tick")


def test_the_robots_time_is_the_same_in_all_processes(environment: Mapping[str, str]) -> None:
    nodes = [Recorder(name, topics.TICKS) for name in ("one", "two")]
    hosts = [Host.open(place(environment), [node]) for node in nodes]
    with (
        running(hosts[0]),
        running(hosts[1]),
        Network.open(place(environment), listens=("Clock",)) as network,
    ):
        until(lambda: len(network.alive()) == 2, "both are there")
        _Outside(network).put(topics.TICKS, codec.encode(Tick(k=0, t_ns=0)))
        until(lambda: all(node.got for node in nodes), "both heard it")
    assert abs(nodes[0].times[0] - nodes[1].times[0]) < 10_000_000_000


class _Threads(Recorder):
    """Notes in which threads it handles what."""

    def __init__(self, *listens: str, on: Callable[[Message, int], Iterable[Effect]]) -> None:
        super().__init__(SERVER, *listens, on=on)
        self.threads: list[int] = []

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        self.threads.append(threading.get_ident())
        return super().handle(message, now_ns)


def test_a_direct_host_handles_frames_where_they_come_in_and_calls_and_wakes_in_its_own_thread(
    environment: Mapping[str, str], outside: _Outside
) -> None:
    def wake(message: Message, now_ns: int) -> Iterable[Effect]:
        if isinstance(message, Tick):
            yield WakeAt(now_ns + 1_000_000)

    node = _Threads(CALLS, topics.TICKS, on=wake)
    with Host.open(place(environment), [node], serves=True, direct=True) as host, running(host) as run:
        until(lambda: SERVER in outside.network.alive(), "it is there")
        outside.put(topics.TICKS, codec.encode(Tick(k=0, t_ns=0)))
        until(lambda: len(node.got) == 2, "the tick and the wake")
        outside.call(plain_call("u/a", 1))
        until(lambda: len(node.got) == 3, "the call")
        own = run.thread.ident
    assert [type(message) for message in node.got] == [Tick, Wake, Call]
    assert [thread == own for thread in node.threads] == [False, True, True]


def test_a_direct_host_loses_nothing_and_keeps_the_order_while_calls_come_between(
    environment: Mapping[str, str], outside: _Outside
) -> None:
    many = 300
    node = Recorder(SERVER, CALLS, topics.TICKS)
    second = Recorder("Second", topics.TICKS)
    with Host.open(place(environment), [node, second], serves=True, direct=True) as host, running(host):
        until(lambda: SERVER in outside.network.alive(), "it is there")
        for k in range(many):
            outside.put(topics.TICKS, codec.encode(Tick(k=k, t_ns=0)))
            if k % 3 == 0:
                outside.call(plain_call("u/a", 1 + k))
        until(lambda: len(node.got) == many + many // 3, "all are handled")
    assert [message.k for message in second.got if isinstance(message, Tick)] == [*range(many)]
    assert [message.k for message in node.got if isinstance(message, Tick)] == [*range(many)]


def test_nodes_of_a_direct_host_hear_each_other(environment: Mapping[str, str], outside: _Outside) -> None:
    def pass_on(message: Message, now_ns: int) -> Iterable[Effect]:
        assert isinstance(message, Tick)
        yield Send(topics.frames(topics.CLOCK), message)

    nodes = [
        Recorder(SERVER, topics.TICKS, on=pass_on),
        Recorder("listener", topics.frames(topics.CLOCK)),
    ]
    with Host.open(place(environment), nodes, serves=True, direct=True) as host, running(host):
        until(lambda: SERVER in outside.network.alive(), "it is there")
        for k in range(100):
            outside.put(topics.TICKS, codec.encode(Tick(k=k, t_ns=0)))
        until(lambda: len(nodes[1].got) == 100, "all were passed on")
    assert nodes[1].got == nodes[0].got


LARGE = """
import os, signal, sys
from colony.runtime.protocol import topics
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.place import local
from colony.runtime.protocol.messages import Checkpoint, Send
from tests.runtime.calling import plain_call
from tests.runtime.transport.live.stage import Recorder

def save(message, now_ns):
    saved = Checkpoint(client="c", k=message.k, start=0, memory=bytes(1_000_000))
    yield Send(topics.checkpoints("DServer"), saved)

with Host.open(local("rome", os.environ), [Recorder("drive/c", topics.TICKS, on=save)], direct=True) as host:
    signal.signal(signal.SIGTERM, lambda *_: host.stop())
    host.run()
"""


def test_with_one_thread_for_the_network_a_large_checkpoint_gets_through(
    environment: Mapping[str, str],
) -> None:
    server = Recorder("DServer", topics.checkpoints("DServer"))
    alone = {"ZENOH_RUNTIME": ONE_THREAD, "PYTHONPATH": str(Path(__file__).parents[4])}
    process = subprocess.Popen([sys.executable, "-c", LARGE], env={**os.environ, **environment, **alone})
    try:
        with (
            hosted(environment, [server]) as host,
            Network.open(place(environment), listens=("Clock",)) as clock,
        ):
            until(lambda: "drive/c" in clock.alive(), "it is there for the Clock")
            until(lambda: "drive/c" in host.network.alive(), "it is there for DServer")
            went: list[str] = []
            host.network.watch(lambda address, present: went.append(address))
            for k in range(5):
                _Outside(clock).put(topics.TICKS, codec.encode(Tick(k=k, t_ns=0)))
            until(lambda: len(server.got) == 5, "all came")
            assert went == [], "its link was given up"
            process.send_signal(signal.SIGTERM)
            assert process.wait(20) == 0
    finally:
        process.kill()
        process.wait()


FROZEN = """
import os, signal, sys
from colony.runtime.protocol import topics
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.place import local
from tests.runtime.calling import plain_call
from tests.runtime.transport.live.stage import Recorder

with Host.open(local("rome", os.environ), [Recorder("drive/frozen", topics.frames("PServer"))]) as host:
    print("ready", flush=True)
    host.run()
"""


def test_a_reader_that_is_frozen_does_not_hold_up_a_server(environment: Mapping[str, str]) -> None:
    frames, fields = 200, {"big": Sample(tuple(float(n) for n in range(10_000)), 0)}

    def publish_frames(message: Message, now_ns: int) -> Iterable[Effect]:
        if len(server.got) <= frames:
            topic = topics.frames("PServer")
            yield Send(topic, ServerFrame(server="PServer", k=len(server.got), fields=fields))
            yield WakeAt(now_ns + 1_000_000)

    server = Recorder("PServer", topics.TICKS, on=publish_frames)
    process = subprocess.Popen(
        [sys.executable, "-c", FROZEN],
        env={**os.environ, **environment, "PYTHONPATH": str(Path(__file__).parents[4])},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        with hosted(environment, [server]) as host:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            until(lambda: "drive/frozen" in host.network.alive(), "the reader is there")
            process.send_signal(signal.SIGSTOP)
            with Network.open(place(environment)) as network:
                _Outside(network).put(topics.TICKS, codec.encode(Tick(k=0, t_ns=0)))
            until(lambda: len(server.got) > frames, "all frames are published")
    finally:
        process.kill()
        process.communicate()
    gaps = [b - a for a, b in zip(server.times, server.times[1:], strict=False)]
    assert max(gaps) < BLOCKED_US * 1000 // 2, "who waits for room is held up until the link is given up"


PROCESS = """
import os, signal, sys
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.place import local
from tests.runtime.calling import plain_call
from tests.runtime.transport.live.stage import Recorder

class Node(Recorder):
    def close(self):
        print("closed", flush=True)

with Host.open(local("rome", os.environ), [Node("RServer")], serves=True) as host:
    signal.signal(signal.SIGTERM, lambda *_: host.stop())
    print("ready", flush=True)
    host.run()
print("ended", flush=True)
"""


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_a_process_ends_by_a_signal_and_another_takes_its_place(
    environment: Mapping[str, str], how: signal.Signals
) -> None:
    for _ in range(2):
        process = subprocess.Popen(
            [sys.executable, "-c", PROCESS],
            env={**os.environ, **environment, "PYTHONPATH": str(Path(__file__).parents[4])},
            stdout=subprocess.PIPE,
            text=True,
        )
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        with Network.open(place(environment)) as network:
            until(lambda n=network: n.alive() == (SERVER,), "it is there")  # type: ignore[misc]
            process.send_signal(how)
            rest = process.communicate(timeout=20)[0]
            until(lambda n=network: n.alive() == (), "it is gone")  # type: ignore[misc]
        assert rest == ("closed\nended\n" if how is signal.SIGTERM else "")
        assert process.returncode == (0 if how is signal.SIGTERM else -9)


def _stop(connection: str, number: int) -> Call:
    return msgspec.structs.replace(plain_call(connection, number, right="stop"), method=EMERGENCY_STOP)


def test_an_emergency_stop_has_a_thread_of_its_own_and_goes_before_all_that_waits(
    environment: Mapping[str, str], outside: _Outside
) -> None:
    """The node is busy with a message, and hundreds wait, when the stop comes."""
    threads: list[str] = []
    node = _Blocked(then=lambda: threads.append(threading.current_thread().name))
    with hosted(environment, [node]) as host:
        outside.put(topics.TICKS, codec.encode(Tick(k=0, t_ns=0)))
        assert node.busy.wait(20)
        for number in range(1, CALLS_EACH + 1):
            outside.call(plain_call("u/flood", number, priority=1 << 40))
        until(lambda: len(host._inbox._room._calls) == CALLS_EACH, "they wait")
        stop = _stop("u/stop", 1)
        outside.call(stop)
        until(lambda: not host._calm.is_set(), "the stop is next")
        node.go.set()
        until(lambda: len(node.got) == CALLS_EACH + 2, "all are handled")
    assert node.got[1] == stop
    assert threads[1] == "emergency stops"
    assert "emergency stops" not in {t.name for t in threading.enumerate()}


def test_an_answer_that_nobody_takes_does_not_hold_up_a_stop(environment: Mapping[str, str]) -> None:
    """The thread that sends waits for room, which another process does not make."""
    sending, go_on = threading.Event(), threading.Event()
    node = Recorder(SERVER, CALLS, on=_echo)
    with hosted(environment, [node]) as host, Network.open(place(environment)) as network:
        send = host._outbox.send

        def blocked(topic: str, message: Sent, now_ns: int) -> None:
            sending.set()
            assert go_on.wait(20)
            send(topic, message, now_ns)

        host._outbox.send = blocked  # type: ignore[method-assign]
        for number, call in enumerate((plain_call("u/a", 1), _stop("u/a", 2))):
            key = keys.sending(ROBOT, CALLS, call, user="u")
            with publish(network.session, key) as publisher:
                until(lambda p=publisher: p.matching_status.matching, "the server listens")  # type: ignore[misc]
                publisher.put(codec.encode(call))
            until(lambda n=number: len(node.got) > n, "it is handled")  # type: ignore[misc]
            assert sending.wait(20)
        go_on.set()


def _echo(message: Message, now_ns: int) -> Iterable[Effect]:
    if isinstance(message, Call):
        reply = Reply(connection=message.connection, number=message.number)
        yield Send(topics.replies(SERVER, message.connection), reply)


def test_what_comes_under_the_right_to_stop_and_is_no_stop_waits_as_other_calls_do(
    environment: Mapping[str, str], outside: _Outside
) -> None:
    node = Recorder(SERVER, CALLS)
    with hosted(environment, [node]):
        call = plain_call("u/a", 1, right="stop")
        outside.call(call)
        outside.put(f"{CALLS}/stop/u/a", b"nonsense")
        until(lambda: len(node.got) == 2, "both are handled")
    assert node.got[0] == call
    assert isinstance(node.got[1], Malformed)


def test_a_frame_that_cannot_be_yet_is_malformed(environment: Mapping[str, str], outside: _Outside) -> None:
    node = Recorder(SERVER, topics.TICKS)
    with hosted(environment, [node]):
        outside.put(topics.TICKS, codec.encode(Tick(k=1 << 62, t_ns=0)))
        outside.put(topics.TICKS, codec.encode(Tick(k=1, t_ns=0)))
        until(lambda: len(node.got) == 2, "both are handled")
    assert isinstance(node.got[0], Malformed)
    assert node.got[1] == Tick(k=1, t_ns=0)
