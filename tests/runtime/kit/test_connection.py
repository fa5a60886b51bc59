"""Connections that wait for answers, to a server over zenoh."""

from __future__ import annotations

import math
import os
import signal
import threading
from collections.abc import Iterator, Mapping

import msgspec
import pytest

from colony.runtime.kit.connection import Connection, Session, connect
from colony.runtime.kit.errors import (
    CallRefusedError,
    CallTimeoutError,
    ConnectionLostError,
    ServerNotFoundError,
)
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol import topics
from colony.runtime.protocol.calls import CallDispatcher, CallId, NoArguments, method
from colony.runtime.protocol.messages import Effect, Message
from colony.runtime.transport.live.robot_address import local
from tests.runtime.kit.stage import (
    BATTERY,
    battery_process,
    battery_thread,
    charge,
    gone,
    halt,
    level,
    plain,
)
from tests.runtime.transport.live.stage import ROBOT, Recorder, hosted, python_process, run_directory
from tests.waiting import until


@pytest.fixture
def battery(environment: Mapping[str, str]) -> Iterator[Connection]:
    with battery_thread(environment), connect(BATTERY, robot=ROBOT, environment=environment) as connection:
        yield connection


def test_a_server_does_what_it_is_asked(battery: Connection) -> None:
    assert battery.do(level()) == 0.5
    assert battery.do(charge(1.0)) == pytest.approx(0.6)
    assert battery.do(halt()) == "halted"
    assert battery.openings >= 1


def test_the_two_halves_of_an_exchange_apart(battery: Connection) -> None:
    battery.send(level())
    later = battery.send(charge(1.0))
    assert battery.recv() == 0.5
    assert battery.recv() == later.result() == pytest.approx(0.6)
    with pytest.raises(LookupError, match="every call sent to Battery"):
        battery.recv()


def test_the_server_knows_who_calls(environment: Mapping[str, str]) -> None:
    with (
        battery_thread(environment),
        connect(BATTERY, robot=ROBOT, name="joystick", priority=7, environment=environment) as connection,
    ):
        caller = connection.do(plain("who", list))
    assert isinstance(caller, list)
    identity, name, priority, user = caller
    assert (name, priority) == ("joystick", 7)
    assert identity.startswith(f"{user}/")


@pytest.mark.parametrize(
    ("ask", "code", "says"),
    [
        (plain("fly"), "method", "Battery has no method `fly`; it has open, close, status, level"),
        (charge(-1.0), "range", "-1 A: expected 0 or more"),
        (CallRequest("charge", NoArguments(), float, "command"), "arguments", "Battery.charge: .*amperes"),
        (
            CallRequest("charge", NoArguments(), float, "read"),
            "right",
            "Battery.charge needs the right to command, not",
        ),
        (plain("fail"), "failed", "Battery.fail failed: ZeroDivisionError: division by zero"),
        (
            CallRequest("level", NoArguments(), str, "read"),
            "reply",
            "Battery.level returned an invalid result: Expected `str`",
        ),
    ],
)
def test_what_the_server_does_not_do(
    battery: Connection, ask: CallRequest[object], code: str, says: str
) -> None:
    with pytest.raises(CallRefusedError, match=says) as refused:
        battery.do(ask)
    assert refused.value.code == code
    assert battery.do(level()) == 0.5


def test_an_answer_that_does_not_come_in_time(environment: Mapping[str, str]) -> None:
    with (
        battery_thread(environment) as server,
        connect(BATTERY, robot=ROBOT, environment=environment) as connection,
    ):
        server.wait.clear()
        with pytest.raises(CallTimeoutError, match=r"Battery did not answer `wait` in 0\.05 s"):
            connection.do(plain("wait"), timeout_s=0.05)
        server.wait.set()
        assert connection.do(level()) == 0.5


def test_a_call_may_ask_for_more_time_than_the_connection_gives(environment: Mapping[str, str]) -> None:
    with (
        battery_thread(environment) as server,
        connect(BATTERY, robot=ROBOT, environment=environment, timeout_s=2.0) as connection,
    ):
        server.wait.clear()
        answer = connection.send(CallRequest("wait", NoArguments(), bool, "command", wait_s=20.0))
        assert answer._timeout_s == 20.0
        server.wait.set()
        assert answer.result() is True


@pytest.mark.parametrize("wait_s", [math.inf, 1e300])
def test_a_call_may_wait_for_ever(battery: Connection, wait_s: float) -> None:
    assert battery.do(level()._replace(wait_s=wait_s)) == 0.5


def test_threads_share_a_connection(battery: Connection) -> None:
    results: list[float] = []

    def many() -> None:
        results.extend(battery.do(level()) for _ in range(50))

    threads = [threading.Thread(target=many) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    assert results == [0.5] * 200


def test_connections_share_a_session(environment: Mapping[str, str]) -> None:
    with battery_thread(environment), Session.open(ROBOT, environment=environment) as session:
        until(lambda: session.servers() == (BATTERY,), "its link is there")
        with session.connect(BATTERY) as one, session.connect(BATTERY, priority=3) as two:
            assert one.do(charge(1.0)) == two.do(level())
        with session.connect(BATTERY) as three:
            until(lambda: len(three.do(plain("status", dict))["connections"]) == 1, "the others are closed")  # type: ignore[index]


def test_nobody_there(environment: Mapping[str, str]) -> None:
    with pytest.raises(
        ServerNotFoundError, match=r"no robot `rome` on this machine: /tmp/.* does not exist .*none"
    ):
        connect(BATTERY, robot=ROBOT, environment=environment)
    with battery_thread(environment):
        with pytest.raises(ServerNotFoundError, match=r"no robot `siena` .*robots found: rome"):
            connect(BATTERY, robot="siena", environment=environment)
        with pytest.raises(ServerNotFoundError, match="rome has no Radio: found Battery"):
            connect("Radio", robot=ROBOT, environment=environment, timeout_s=0.2)
    with pytest.raises(
        ServerNotFoundError, match=r"no process of rome runs on this machine \(looked in /tmp"
    ):
        connect(BATTERY, robot=ROBOT, environment=environment, timeout_s=0.2)


def test_a_server_that_answers_nothing(environment: Mapping[str, str]) -> None:
    silent = Recorder("Silent", topics.calls("Silent"))
    with (
        hosted(environment, [silent]),
        pytest.raises(ServerNotFoundError, match="Silent of rome is up but does not answer"),
    ):
        connect("Silent", robot=ROBOT, environment=environment, timeout_s=0.2)


def test_a_server_whose_process_is_frozen_is_up(environment: Mapping[str, str]) -> None:
    with (
        battery_thread(environment),
        local(ROBOT, environment).directory.claim("Frozen"),
        pytest.raises(ServerNotFoundError, match="Frozen of rome is up but does not answer"),
    ):
        connect("Frozen", robot=ROBOT, environment=environment, timeout_s=0.2)


def test_a_server_that_starts_late_is_waited_for(environment: Mapping[str, str]) -> None:
    with battery_thread(environment), Session.open(ROBOT, environment=environment) as session:
        found: list[float] = []

        def ask() -> None:
            with session.connect("Late") as late:
                found.append(late.do(CallRequest("one", NoArguments(), float, "read")))

        asking = threading.Thread(target=ask)
        asking.start()
        with hosted(environment, [_Late()]):
            asking.join(20)
    assert found == [1.0]


class _Late:
    address = "Late"

    def __init__(self) -> None:
        self._desk = CallDispatcher("Late", (method("one", NoArguments, lambda *_: 1.0, right="read"),))
        self.listens = self._desk.listens

    def start(self, now_ns: int) -> Iterator[Effect]:
        return iter(())

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        return self._desk.handle(message, now_ns)

    def close(self) -> None: ...


class _Telling(_Late):
    """Tells the caller of something, as often as it was asked to."""

    address = "Telling"

    def __init__(self) -> None:
        self.asked: list[CallId] = []
        self._desk = CallDispatcher("Telling", (method("watch", NoArguments, self._watch, right="read"),))
        self.listens = self._desk.listens

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        yield from self._desk.handle(message, now_ns)
        for number, asked in enumerate(self.asked):
            yield from self._desk.notify(asked.caller, "count", number)
        self.asked.clear()

    def _watch(self, asked: CallId, nothing: NoArguments, now_ns: int) -> None:
        self.asked.extend([asked] * 3)


def test_notices_come_in_their_order(environment: Mapping[str, str]) -> None:
    with (
        hosted(environment, [_Telling()]),
        connect("Telling", robot=ROBOT, environment=environment) as connection,
    ):
        connection.keep(CallRequest("watch", NoArguments(), None, "read"))
        came = connection.notices(timeout_s=20)
        three = [next(came) for _ in range(3)]
        assert [(n.subject, msgspec.msgpack.decode(n.body)) for n in three] == [
            ("count", k) for k in range(3)
        ]
        assert list(connection.notices(timeout_s=0.01)) == []


def test_a_server_that_is_started_anew_is_found_again(environment: Mapping[str, str]) -> None:
    with (
        battery_process(environment) as first,
        connect(BATTERY, robot=ROBOT, environment=environment, timeout_s=20) as connection,
    ):
        assert connection.do(charge(1.0)) == pytest.approx(0.6)
        gone(first)
        waiting = connection.send(level())
        with battery_process(environment) as second:
            assert waiting.result() == 0.5
            assert connection.openings >= 2
            os.kill(second.pid, signal.SIGSTOP)
            lost, waiting = connection.send(charge(1.0)), connection.send(level())
            gone(second)
            with pytest.raises(ConnectionLostError, match="Battery went away before it answered"):
                lost.result()
        with battery_process(environment):
            assert waiting.result() == 0.5
            assert connection.do(charge(1.0)) == pytest.approx(0.6)


def test_who_was_frozen_for_longer_than_the_lease_is_lost_and_comes_back(
    environment: Mapping[str, str],
) -> None:
    with (
        battery_thread(environment),
        Session.open(ROBOT, environment=environment) as session,
        session.connect(BATTERY, timeout_s=20) as connection,
        session.connect(BATTERY) as other,
    ):
        channel = connection._channel
        session.hub._channels.discard(channel)  # nobody tends it any more
        until(lambda: _connected(other) == 1, "the silent one is lost")
        session.hub._channels.add(channel)
        until(lambda: connection.openings >= 2, "it opens anew")
        assert connection.do(level()) == 0.5


def _connected(connection: Connection) -> int:
    status = connection.do(plain("status", dict))
    return len(status["connections"])


def test_a_closed_connection_says_so(environment: Mapping[str, str]) -> None:
    with battery_thread(environment):
        connection = connect(BATTERY, robot=ROBOT, environment=environment)
        connection.close()
        connection.close()
        with pytest.raises(ConnectionLostError, match="the connection to Battery was closed"):
            connection.do(level())


def test_what_cannot_be_asked_is_told_at_once(battery: Connection) -> None:
    with pytest.raises(
        TypeError, match=r"not a call: <function level at .*>: call it; expected the result of a"
    ):
        battery.do(level)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="not a call: 'level'; expected"):
        battery.send("level")  # type: ignore[arg-type]


def test_how_a_connection_cannot_be_opened(environment: Mapping[str, str]) -> None:
    with battery_thread(environment), Session.open(ROBOT, environment=environment) as session:
        with pytest.raises(TypeError, match="priority of a connection is 'high'; expected a whole number"):
            session.connect(BATTERY, priority="high")  # type: ignore[arg-type]
        with pytest.raises(TypeError, match="name of a connection is 7; expected text"):
            session.connect(BATTERY, name=7)  # type: ignore[arg-type]


def test_a_thousand_connections_are_one_key_to_the_network() -> None:
    """zenoh keeps a little of every key that was ever declared."""
    with (
        run_directory() as environment,
        battery_thread(environment),
        Session.open(ROBOT, environment=environment) as session,
    ):
        hub = session.hub
        connections = [session.connect(BATTERY) for _ in range(3)]
        ids = {connection._channel._conversation.connection for connection in connections}
        assert len(ids) == 3
        assert {id.partition("/")[2][:3] for id in ids} == {f"{hub._bucket}-"}
        assert set(hub._channels_by_connection) == ids
        for connection in connections:
            assert connection.do(level()) == 0.5
            connection.close()
        assert hub._channels_by_connection == {}


FORKS = """
import asyncio, multiprocessing, os, sys, threading
from colony.runtime.kit import aio
from colony.runtime.kit.connection import Session, connect
from colony.runtime.kit.emergency import StopButton
from colony.runtime.kit.server import Server
from colony.runtime.transport.live.run_directory import ForkedError
from tests.runtime.kit.stage import BATTERY, ROBOT, charge, level

async def open_async():
    async with aio.connect(BATTERY, robot=ROBOT) as connection:
        await connection.do(level())

def refused(what):
    try:
        uses[what]()
    except ForkedError:
        return True
    return False

session = Session.open(ROBOT)
battery = session.connect(BATTERY)
sent, button = battery.send(level()), StopButton(session)
uses = {
    "do": lambda: battery.do(level()), "send": lambda: battery.send(charge(1.0)), "recv": battery.recv,
    "notices": lambda: next(battery.notices()), "connect": lambda: connect(BATTERY, robot=ROBOT),
    "session": lambda: session.connect(BATTERY), "servers": session.servers, "press": button.press,
    "serve": lambda: Server.open("Own", robot=ROBOT), "async": lambda: asyncio.run(open_async()),
}
for what in uses:
    battery._hub._lock.acquire(), battery._channel._lock.acquire()  # as another thread may hold them
    pid = os.fork()
    if pid == 0:
        said = refused(what)
        session.close(), battery.close()
        sys.exit(0 if said else 1)
    battery._hub._lock.release(), battery._channel._lock.release()
    assert os.waitpid(pid, 0)[1] == 0, what
with multiprocessing.get_context("fork").Pool(1) as pool:
    assert pool.map(refused, uses) == [True] * len(uses)
assert battery.recv() == 0.5, "the parent goes on"
battery.do(level())
session.close()
print("done", flush=True)
"""


def test_connections_are_refused_at_once_in_a_forked_process(environment: Mapping[str, str]) -> None:
    with battery_thread(environment), python_process(environment, "-c", FORKS, says="done"):
        pass


def test_a_process_that_was_forked_before_its_parent_connected_can_connect(
    environment: Mapping[str, str],
) -> None:
    script = """
import os
from colony.runtime.kit.connection import connect
from tests.runtime.kit.stage import BATTERY, ROBOT, level
pid = os.fork()
with connect(BATTERY, robot=ROBOT) as battery:
    assert battery.do(level()) == 0.5
if pid == 0:
    os._exit(0)
assert os.waitpid(pid, 0)[1] == 0
print("done", flush=True)
"""
    with battery_thread(environment), python_process(environment, "-c", script, says="done"):
        pass
