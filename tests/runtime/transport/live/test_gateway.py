"""Who gets through a gateway, with what, and what those are told who do not."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from colony.runtime.assembly.processes import child
from colony.runtime.kit.connection import Session
from colony.runtime.kit.errors import CallRefusedError, ServerNotFoundError
from colony.runtime.library import robot
from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.messages import (
    Alive,
    Bounds,
    Call,
    Effect,
    Malformed,
    Message,
    Reply,
    Request,
    SendMessage,
    Tick,
    Wake,
    WakeAt,
)
from colony.runtime.transport.live import gateway, keys
from colony.runtime.transport.live.gateway import GatewayNode
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.robot_time import learned_time
from colony.runtime.transport.live.run_directory import GatewayFullError, UnreachableError
from colony.runtime.transport.live.security import read_security
from tests.kit.calling import plain_call
from tests.runtime.kit.stage import BATTERY, battery_thread, charge, halt, level
from tests.runtime.transport.live.certificates import Authority, free_port
from tests.runtime.transport.live.gateway_lab import USERS, Lab, gateway_for, listen, put
from tests.runtime.transport.live.stage import ROBOT, Recorder, hosted, run_directory, running
from tests.waiting import until


def test_a_user_does_what_the_table_allows(lab: Lab) -> None:
    with battery_thread(lab.environment), lab.session("ada") as session:
        until(lambda: BATTERY in session.servers(), "the gateway found the server")
        with session.connect(BATTERY, priority=4) as battery:
            assert battery.do(level()) == 0.5
            assert battery.do(charge(1.0)) == pytest.approx(0.6)
            assert battery.do(halt()) == "halted", "who may command may stop"
        with pytest.raises(ServerNotFoundError, match="rome has no Radio: found Battery, Gateway"):
            session.connect("Radio", timeout_s=0.2)


@pytest.mark.parametrize(("user", "says"), [("bob", "bob may only read"), ("carl", "carl may only stop")])
def test_a_user_without_the_right_is_told_so(lab: Lab, user: str, says: str) -> None:
    with (
        battery_thread(lab.environment) as server,
        lab.session(user) as session,
        session.connect(BATTERY) as battery,
    ):
        with pytest.raises(
            CallRefusedError, match=f"charge needs the right to command, and {says}"
        ) as refused:
            battery.do(charge(1.0))
        assert refused.value.code == "right"
        assert battery.do(level()) == 0.5
        if user == "carl":
            assert battery.do(halt()) == "halted"
    assert server.charges == 0


def test_nobody_ignores_limits_without_the_right(lab: Lab) -> None:
    with (
        battery_thread(lab.environment),
        lab.session("ada") as session,
        session.connect(BATTERY) as battery,
        pytest.raises(
            CallRefusedError, match="needs the right to ignore limits, and ada may only"
        ) as refused,
    ):
        battery.do(robot.ignore_limits())
    assert refused.value.code == "right"


def test_who_does_not_ask_the_kit_does_not_get_past_the_gateway_either(lab: Lab) -> None:
    node = Recorder("RServer", topics.calls("RServer"), topics.requests("RServer"))
    with hosted(lab.environment, [node]), ZenohSession.open(lab.remote("bob")) as network:
        until(lambda: "RServer" in network.alive(), "the gateway found the server")
        forged = (
            ("command", "bob/1", plain_call("bob/1", right="command")),
            ("stop", "bob/1", plain_call("bob/1", right="stop")),
            ("read", "ada/1", plain_call("ada/1", right="read")),
        )
        for right, connection, message in forged:
            key = f"colony/{ROBOT}/RServer/call/{right}/{connection}"
            network.session.put(key, codec.encode(message))
        request = Request(k=1, actuator="drive", client="wander", bid="command", values=(1.0, 0.0))
        bounds = Bounds(k=1, actuator="drive", low=(0.0, 0.0), high=(600.0, 90.0))
        for message in (request, bounds):
            network.session.put(f"colony/{ROBOT}/RServer/requests/bob", codec.encode(message))
        unlimited = plain_call("bob/1", right="unlimited")
        network.session.put(f"colony/{ROBOT}/RServer/call/unlimited/bob/1", codec.encode(unlimited))
        honest = Alive(connection="bob/1")
        put(network, f"colony/{ROBOT}/RServer/call/read/bob/1", codec.encode(honest))
        until(lambda: bool(node.got), "the honest one")
    assert node.got == [honest]


def test_who_claims_another_name_in_the_message_is_refused(lab: Lab) -> None:
    node = Recorder("RServer", topics.calls("RServer"))
    with hosted(lab.environment, [node]), ZenohSession.open(lab.remote("bob")) as network:
        data = codec.encode(plain_call("ada/1", right="read"))
        put(network, f"colony/{ROBOT}/RServer/call/read/bob/1", data)
        until(lambda: bool(node.got), "it is told of")
    malformed = node.got[0]
    assert isinstance(malformed, Malformed)
    assert malformed.connection == "bob/1"
    assert "claims the connection ada/1" in malformed.reason


def test_nobody_hears_the_answers_to_others(lab: Lab) -> None:
    def answer(message: Message, now_ns: int) -> Iterator[Effect]:
        if isinstance(message, Call):
            reply = Reply(connection=message.connection, number=message.number)
            yield SendMessage(topics.replies("RServer", message.connection), reply)

    heard: dict[str, list[object]] = {"ada": [], "bob": []}
    node = Recorder("RServer", topics.calls("RServer"), on=answer)
    with (
        hosted(lab.environment, [node]),
        ZenohSession.open(lab.remote("ada")) as ada,
        ZenohSession.open(lab.remote("bob")) as bob,
    ):
        for network, user in ((ada, "ada"), (bob, "bob")):
            for key in (keys.subscription_key(ROBOT, "RServer/reply/ada/1"), "**", f"colony/{ROBOT}/**"):
                listen(network, key, heard[user])
        put(ada, f"colony/{ROBOT}/RServer/call/read/ada/1", codec.encode(plain_call("ada/1", right="read")))
        until(lambda: any(isinstance(m, Reply) for m in heard["ada"]), "the answer")
        listen(bob, keys.subscription_key(ROBOT, "RServer/reply/bob/1"), heard["bob"])
        put(bob, f"colony/{ROBOT}/RServer/call/read/bob/1", codec.encode(plain_call("bob/1", right="read")))
        until(lambda: any(isinstance(m, Reply) for m in heard["bob"]), "one's own")
    answers = {user: {m.connection for m in heard[user] if isinstance(m, Reply)} for user in heard}
    assert answers == {"ada": {"ada/1"}, "bob": {"bob/1"}}
    assert not any(isinstance(m, Call) and m.connection == "ada/1" for m in heard["bob"])


class _Clock(Recorder):
    """Ticks every 5 ms."""

    def __init__(self) -> None:
        super().__init__(topics.CLOCK, on=self._tick, begin=lambda now: [WakeAt(now)])
        self.k = 0

    def _tick(self, message: Message, now_ns: int) -> Iterator[Effect]:
        if isinstance(message, Wake):
            self.k += 1
            yield SendMessage(topics.TICKS, Tick(k=self.k, t_ns=now_ns))
            yield WakeAt(now_ns + 5_000_000)


def test_a_client_of_a_program_runs_on_another_machine(lab: Lab) -> None:
    def request(message: Message, now_ns: int) -> Iterator[Effect]:
        if isinstance(message, Tick):
            yield SendMessage(
                topics.requests("RServer"),
                Request(k=message.k, actuator="drive", client="wander", bid="silent"),
            )

    server = Recorder("RServer", topics.requests("RServer"))
    client = Recorder("drive/wander", topics.TICKS, on=request)
    with (
        hosted(lab.environment, [_Clock()]) as clock,
        hosted(lab.environment, [server]),
        Host.open(lab.remote("eva"), [client]) as remote,
        running(remote),
    ):
        until(lambda: len(server.got) >= 3, "requests come")
        until(lambda: "drive/wander" in clock.network.alive(), "it is seen to be there")
    assert {m.client for m in server.got if isinstance(m, Request)} == {"wander"}
    late = [t - m.t_ns for t, m in zip(client.times, client.got, strict=True) if isinstance(m, Tick)]
    assert all(-1_000_000 < ns < 5_000_000_000 for ns in late), "its time is the robot's"


def test_no_clock_no_time(lab: Lab) -> None:
    with (
        ZenohSession.open(lab.remote("eva")) as network,
        pytest.raises(UnreachableError, match="no tick of its Clock"),
    ):
        learned_time(network, timeout_s=0.1)


def test_a_server_stays_on_the_robots_machine(lab: Lab) -> None:
    with pytest.raises(ValueError, match="RServer cannot serve rome from another machine"):
        Host.open(lab.remote("eva"), [Recorder("RServer")], serves=True)


def test_a_gateway_that_is_started_anew_is_found_again(tmp_path: Path) -> None:
    with run_directory() as environment, battery_thread(environment):
        lab = Lab(environment, Authority(tmp_path), f"tls/localhost:{free_port()}")
        with ExitStack() as holds:
            with gateway_for(lab, USERS):
                session = holds.enter_context(lab.session("ada"))
                battery = holds.enter_context(session.connect(BATTERY, timeout_s=20))
                assert battery.do(level()) == 0.5
            until(lambda: session.servers() == (), "the gateway is gone")
            with gateway_for(lab, USERS):
                assert battery.do(level()) == 0.5
                assert battery.do(charge(1.0)) == pytest.approx(0.6)


def test_a_server_of_the_kit_that_starts_after_its_client(lab: Lab) -> None:
    with (
        Session.open(ROBOT, environment=lab.environment) as at_home,
        lab.session("ada") as session,
        hosted(lab.environment, [Recorder("RServer")]),
    ):
        until(lambda: "RServer" in at_home.servers(), "a process to gossip with")
        with battery_thread(lab.environment):
            for found in (at_home, session):
                with found.connect(BATTERY, timeout_s=20) as battery:
                    assert battery.do(level()) == 0.5


def test_a_gateway_whose_memory_is_full_begins_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As the same process, for a supervisor or a person who started it."""
    used = [46 << 20]
    node = GatewayNode(read_security(Authority(tmp_path).table(USERS)), memory=lambda: used[0])
    (wake,) = node.start(0)
    assert isinstance(wake, WakeAt)
    used[0] += gateway.MAX_GROWTH_BYTES
    assert list(node.handle(Wake(), wake.t_ns)) == [WakeAt(2 * wake.t_ns)]
    used[0] += 1 << 20
    assert list(node.handle(Wake(), 2 * wake.t_ns - 1)) == [], "not looked at yet"
    with pytest.raises(GatewayFullError, match="Gateway: it uses 175 MiB of memory; expected at most 174"):
        list(node.handle(Wake(), 2 * wake.t_ns))


def test_it_is_the_same_command_that_begins_again(monkeypatch: pytest.MonkeyPatch) -> None:
    began: list[list[str]] = []
    monkeypatch.setattr(child.os, "execv", lambda program, arguments: began.append([program, *arguments]))
    monkeypatch.setattr(child.sys, "orig_argv", ["python", "-P", "-m", "module", "spec.json"])
    child.restart_in_place()
    assert began == [[sys.executable, sys.executable, "-P", "-m", "module", "spec.json"]]
