"""Who gets through a gateway, with what, and what those are told who do not."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

import msgspec
import pytest
import zenoh

from colony.runtime.assembly.processes import child
from colony.runtime.kit.connection import Session, connect
from colony.runtime.kit.errors import CallRefused, ServerNotFound
from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.messages import (
    Alive,
    Call,
    Effect,
    Malformed,
    Message,
    Reply,
    Request,
    Send,
    Tick,
    Wake,
    WakeAt,
)
from colony.runtime.transport.live import configuration, gateway, keys
from colony.runtime.transport.live.errors import GatewayFull, NotReached, SecurityError
from colony.runtime.transport.live.gateway import GatewayNode, open_gateway
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.limits import MIDDLE
from colony.runtime.transport.live.network import Network
from colony.runtime.transport.live.outbox import Haste, publish
from colony.runtime.transport.live.place import Credentials, Remote
from colony.runtime.transport.live.robot_time import learned_time
from colony.runtime.transport.live.security import Permission, read_security
from tests.runtime.calling import plain_call
from tests.runtime.kit.stage import BATTERY, battery_thread, charge, halt, level
from tests.runtime.transport.live.certificates import Authority, free_port
from tests.runtime.transport.live.stage import ROBOT, Recorder, hosted, place, run_directory, running, until

USERS: dict[str, tuple[Permission, ...]] = {
    "ada": ("read", "command"),
    "bob": ("read",),
    "carl": ("stop",),
    "eva": ("run",),
}


class _Lab:
    """A robot behind a gateway. Mutable: certificates that were made."""

    def __init__(self, environment: Mapping[str, str], authority: Authority, endpoint: str) -> None:
        self.environment = environment
        self.authority = authority
        self.endpoint = endpoint

    def session(self, who: str | Credentials) -> Session:
        credentials = self.authority.user(who) if isinstance(who, str) else who
        return Session.open(ROBOT, gateway=self.endpoint, credentials=credentials)

    def remote(self, who: str) -> Remote:
        return Remote(robot=ROBOT, endpoint=self.endpoint, credentials=self.authority.user(who))


@contextmanager
def _gateway(lab: _Lab, users: Mapping[str, tuple[Permission, ...]]) -> Iterator[None]:
    security = read_security(lab.authority.table(users))
    with running(open_gateway(place(lab.environment), lab.endpoint, security)):
        yield


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[_Lab]:
    with ExitStack() as holds:
        environment = holds.enter_context(run_directory())
        made = _Lab(environment, Authority(tmp_path), f"tls/localhost:{free_port()}")
        holds.enter_context(_gateway(made, USERS))
        yield made


def test_a_user_does_what_the_table_allows(lab: _Lab) -> None:
    with battery_thread(lab.environment), lab.session("ada") as session:
        until(lambda: BATTERY in session.servers(), "the gateway found the server")
        with session.connect(BATTERY, priority=4) as battery:
            assert battery.do(level()) == 0.5
            assert battery.do(charge(1.0)) == pytest.approx(0.6)
            assert battery.do(halt()) == "halted", "who may command may stop"
        with pytest.raises(ServerNotFound, match="rome has no Radio: found Battery, Gateway"):
            session.connect("Radio", timeout_s=0.2)


@pytest.mark.parametrize(("user", "says"), [("bob", "bob may only read"), ("carl", "carl may only stop")])
def test_a_user_without_the_right_is_told_so(lab: _Lab, user: str, says: str) -> None:
    with (
        battery_thread(lab.environment) as server,
        lab.session(user) as session,
        session.connect(BATTERY) as battery,
    ):
        with pytest.raises(CallRefused, match=f"charge needs the right to command, and {says}") as refused:
            battery.do(charge(1.0))
        assert refused.value.code == "right"
        assert battery.do(level()) == 0.5
        if user == "carl":
            assert battery.do(halt()) == "halted"
    assert server.charges == 0


def test_who_does_not_ask_the_kit_does_not_get_past_the_gateway_either(lab: _Lab) -> None:
    node = Recorder("RServer", topics.calls("RServer"), topics.requests("RServer"))
    with hosted(lab.environment, [node]), Network.open(lab.remote("bob")) as network:
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
        network.session.put(f"colony/{ROBOT}/RServer/requests/bob", codec.encode(request))
        honest = Alive(connection="bob/1")
        _put(network, f"colony/{ROBOT}/RServer/call/read/bob/1", codec.encode(honest))
        until(lambda: bool(node.got), "the honest one")
    assert node.got == [honest]


def test_who_claims_another_name_in_the_message_is_refused(lab: _Lab) -> None:
    node = Recorder("RServer", topics.calls("RServer"))
    with hosted(lab.environment, [node]), Network.open(lab.remote("bob")) as network:
        data = codec.encode(plain_call("ada/1", right="read"))
        _put(network, f"colony/{ROBOT}/RServer/call/read/bob/1", data)
        until(lambda: bool(node.got), "it is told of")
    malformed = node.got[0]
    assert isinstance(malformed, Malformed)
    assert malformed.connection == "bob/1"
    assert "claims to be of ada/1" in malformed.reason


def test_nobody_hears_the_answers_to_others(lab: _Lab) -> None:
    def answer(message: Message, now_ns: int) -> Iterator[Effect]:
        if isinstance(message, Call):
            reply = Reply(connection=message.connection, number=message.number)
            yield Send(topics.replies("RServer", message.connection), reply)

    heard: dict[str, list[object]] = {"ada": [], "bob": []}
    node = Recorder("RServer", topics.calls("RServer"), on=answer)
    with (
        hosted(lab.environment, [node]),
        Network.open(lab.remote("ada")) as ada,
        Network.open(lab.remote("bob")) as bob,
    ):
        for network, user in ((ada, "ada"), (bob, "bob")):
            for key in (keys.listening(ROBOT, "RServer/reply/ada/1"), "**", f"colony/{ROBOT}/**"):
                _listen(network, key, heard[user])
        _put(ada, f"colony/{ROBOT}/RServer/call/read/ada/1", codec.encode(plain_call("ada/1", right="read")))
        until(lambda: any(isinstance(m, Reply) for m in heard["ada"]), "the answer")
        _listen(bob, keys.listening(ROBOT, "RServer/reply/bob/1"), heard["bob"])
        _put(bob, f"colony/{ROBOT}/RServer/call/read/bob/1", codec.encode(plain_call("bob/1", right="read")))
        until(lambda: any(isinstance(m, Reply) for m in heard["bob"]), "one's own")
    answers = {user: {m.connection for m in heard[user] if isinstance(m, Reply)} for user in heard}
    assert answers == {"ada": {"ada/1"}, "bob": {"bob/1"}}
    assert not any(isinstance(m, Call) and m.connection == "ada/1" for m in heard["bob"])


def test_logins_that_are_refused(lab: _Lab, tmp_path: Path) -> None:
    folder = tmp_path / "other"
    folder.mkdir()
    stranger = Authority(folder, "stranger")
    ada, eve = lab.authority.user("ada"), stranger.user("ada")
    forged = Credentials(user="ada", certificate=eve.certificate, key=eve.key, authority=ada.authority)
    fooled = Credentials(user="ada", certificate=ada.certificate, key=ada.key, authority=stranger.path)
    port = lab.endpoint.rsplit(":", 1)[1]
    cases = (
        (forged, lab.endpoint, r"refuses .*ada.pem: .*UNKNOWN_CA"),
        (fooled, lab.endpoint, r"is not to be trusted: .*stranger.pem"),
        (lab.authority.user("ada", expired=True), lab.endpoint, r"refuses .*ada-expired.pem: .*EXPIRED"),
        (lab.authority.user("zoe"), lab.endpoint, r"lets nobody in as zoe: .*table of users for rome"),
        (lab.authority.user("bob", called="ada"), lab.endpoint, r"lets nobody in as ada: .*bob.pem"),
        (
            lab.authority.user("ada"),
            f"tls/127.0.0.2:{port}",
            r"not to be trusted: .*for `127.0.0.2`|Connection refused",
        ),
        (lab.authority.user("ada"), f"tls/localhost:{free_port()}", r"nobody listens .*Connection refused"),
    )
    for (credentials, endpoint, says), problem in zip(cases, _all_refused(cases), strict=True):
        assert isinstance(problem, NotReached), (credentials, endpoint, problem)
        assert _matches(says, str(problem)), problem


def _all_refused(cases: tuple[tuple[Credentials, str, str], ...]) -> list[BaseException | None]:
    """Try all at once: each waits for as long as a gateway may take."""
    found: list[BaseException | None] = [None] * len(cases)

    def attempt(place: int, credentials: Credentials, endpoint: str) -> None:
        try:
            Session.open(ROBOT, gateway=endpoint, credentials=credentials).close()
        except Exception as problem:
            found[place] = problem

    threads = [threading.Thread(target=attempt, args=(n, c, e)) for n, (c, e, _) in enumerate(cases)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    return found


def _matches(pattern: str, text: str) -> bool:
    import re

    return re.search(pattern, text, re.DOTALL | re.IGNORECASE) is not None


def test_nothing_goes_in_the_clear(lab: _Lab) -> None:
    in_the_clear = lab.endpoint.replace("tls/", "tcp/")
    with pytest.raises(SecurityError, match="would go in the clear"):
        connect(BATTERY, robot=ROBOT, gateway=in_the_clear, credentials=lab.authority.user("ada"))
    security = read_security(lab.authority.table(USERS))
    with pytest.raises(SecurityError, match="would go in the clear"):
        open_gateway(place(lab.environment), in_the_clear, security)
    settings = {"mode": "client", "connect/endpoints": [in_the_clear], "connect/timeout_ms": 300}
    with pytest.raises(zenoh.ZError):
        zenoh.open(configuration.configuration({**settings, "scouting/multicast/enabled": False}))


def test_a_certificate_is_wanted(lab: _Lab) -> None:
    with pytest.raises(ValueError, match="a gateway wants to know who comes"):
        Session.open(ROBOT, gateway=lab.endpoint)
    ada = lab.remote("ada")
    settings = {
        key: value
        for key, value in configuration.settings(ada).items()
        if key not in ("transport/link/tls/connect_certificate", "transport/link/tls/connect_private_key")
    }
    settings |= {"transport/link/tls/enable_mtls": False, "connect/timeout_ms": 300}
    with pytest.raises(zenoh.ZError):
        zenoh.open(configuration.configuration(settings))


def test_two_gateways_to_one_robot_and_a_port_that_is_taken(lab: _Lab, tmp_path: Path) -> None:
    security = read_security(lab.authority.table(USERS))
    with pytest.raises(Exception, match="Gateway of rome runs already"):
        open_gateway(place(lab.environment), f"tls/localhost:{free_port()}", security)
    with run_directory() as other, pytest.raises(NotReached, match=r"cannot listen at .*tls/localhost"):
        open_gateway(place(other), lab.endpoint, security)


def test_a_user_who_was_taken_out_of_the_table_is_out(lab: _Lab, tmp_path: Path) -> None:
    with run_directory() as environment:
        other = _Lab(environment, lab.authority, f"tls/localhost:{free_port()}")
        with _gateway(other, USERS), other.session("bob") as session:
            assert session.servers() == ("Gateway",)
        with _gateway(other, {"ada": ("read",)}), pytest.raises(NotReached, match="lets nobody in as bob"):
            other.session("bob")


class _Clock(Recorder):
    """Ticks every 5 ms."""

    def __init__(self) -> None:
        super().__init__(topics.CLOCK, on=self._tick, begin=lambda now: [WakeAt(now)])
        self.k = 0

    def _tick(self, message: Message, now_ns: int) -> Iterator[Effect]:
        if isinstance(message, Wake):
            self.k += 1
            yield Send(topics.TICKS, Tick(k=self.k, t_ns=now_ns))
            yield WakeAt(now_ns + 5_000_000)


def test_a_client_of_a_program_runs_on_another_machine(lab: _Lab) -> None:
    def request(message: Message, now_ns: int) -> Iterator[Effect]:
        if isinstance(message, Tick):
            yield Send(
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


def test_no_clock_no_time(lab: _Lab) -> None:
    with Network.open(lab.remote("eva")) as network, pytest.raises(NotReached, match="no tick of its Clock"):
        learned_time(network, timeout_s=0.1)


def test_a_server_stays_on_the_robots_machine(lab: _Lab) -> None:
    with pytest.raises(ValueError, match="RServer cannot serve rome from another machine"):
        Host.open(lab.remote("eva"), [Recorder("RServer")], serves=True)


def _put(network: Network, key: str, data: bytes) -> None:
    with publish(network.session, key) as publisher:
        until(lambda: publisher.matching_status.matching, f"nobody listens to {key}")  # type: ignore[attr-defined]
        publisher.put(data)


def _listen(network: Network, key: str, heard: list[object]) -> None:
    def take(sample: zenoh.Sample) -> None:
        heard.append(codec.decode(sample.payload.to_bytes()))

    network.session.declare_subscriber(key, zenoh.handlers.Callback(take, indirect=False))


def test_a_gateway_that_is_started_anew_is_found_again(tmp_path: Path) -> None:
    with run_directory() as environment, battery_thread(environment):
        lab = _Lab(environment, Authority(tmp_path), f"tls/localhost:{free_port()}")
        with ExitStack() as holds:
            with _gateway(lab, USERS):
                session = holds.enter_context(lab.session("ada"))
                battery = holds.enter_context(session.connect(BATTERY, timeout_s=20))
                assert battery.do(level()) == 0.5
            until(lambda: session.servers() == (), "the gateway is gone")
            with _gateway(lab, USERS):
                assert battery.do(level()) == 0.5
                assert battery.do(charge(1.0)) == pytest.approx(0.6)


def test_nothing_comes_twice_and_servers_that_come_later_are_found(lab: _Lab) -> None:
    """All are linked to each other and to the gateway; with gossip for some, and without for the gateway."""
    call = plain_call("bob/1", right="read")
    with (
        Network.open(place(lab.environment)) as at_home,
        lab.session("bob") as session,
        Network.open(lab.remote("bob")) as remote,
        hosted(lab.environment, [Recorder("Clock", topics.calls("Clock"))]),
    ):
        until(lambda: {"Clock", "Gateway"} <= set(at_home.alive()), "it is linked to others")
        node = Recorder("Radio", topics.calls("Radio"))
        with hosted(lab.environment, [node]):
            until(lambda: "Radio" in at_home.alive(), "a name that nobody knew, by gossip")
            until(lambda: "Radio" in session.servers(), "and from behind the gateway")
            for network in (at_home, remote):
                _put(network, f"colony/{ROBOT}/Radio/call/read/bob/1", codec.encode(call))
            _put(remote, f"colony/{ROBOT}/Radio/call/read/bob/1", codec.encode(Alive(connection="bob/1")))
            until(lambda: any(isinstance(m, Alive) for m in node.got), "the last one")
            assert node.got.count(call) == 2
    assert len(node.got) == 3


def test_a_server_of_the_kit_that_starts_after_its_client(lab: _Lab) -> None:
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


@pytest.mark.parametrize(
    ("user", "right", "limit"), [("carl", "stop", 1024), ("bob", "read", MIDDLE), ("ada", "command", None)]
)
def test_messages_larger_than_their_right_allows(lab: _Lab, user: str, right: str, limit: int | None) -> None:
    sizes: list[int] = []
    key = f"colony/{ROBOT}/RServer/call/{right}/{user}/1"
    with Network.open(place(lab.environment), listens=("RServer",)) as robot, _remote(lab, user) as network:
        _note(robot, key, lambda sample: sizes.append(len(sample.payload)))
        _put(network, key, b"small")
        until(lambda: sizes == [5], "the small one")
        if limit is not None:
            _put(network, key, bytes(limit + 1))
        _put(network, key, bytes(limit or codec.LARGEST))
        until(lambda: len(sizes) == 2, "the largest one")
    assert sizes == [5, limit or codec.LARGEST]


def test_users_choose_no_priority_and_nobody_waits_for_them(lab: _Lab) -> None:
    found: dict[str, tuple[object, object, bool]] = {}

    def note(sample: zenoh.Sample) -> None:
        found[str(sample.key_expr)] = (sample.priority, sample.congestion_control, sample.express)

    drop, data = zenoh.CongestionControl.DROP, zenoh.Priority.DATA
    calls = f"colony/{ROBOT}/RServer/call"
    frames = f"colony/{ROBOT}/RServer/frames"
    with Network.open(place(lab.environment), listens=("RServer",)) as robot, _remote(lab, "eva") as network:
        _note(robot, f"{calls}/**", note)
        _note(robot, f"colony/{ROBOT}/RServer/requests/*", note)
        _note(network, frames, note)
        _urgent(network, f"{calls}/command/eva/1")
        _urgent(network, f"{calls}/read/eva/1")
        _put(network, f"{calls}/stop/eva/1", b"x")
        _put(network, f"colony/{ROBOT}/RServer/requests/eva", b"x")
        _put(robot, frames, b"x")
        until(lambda: len(found) == 5, "all came")
    assert found == {
        f"{calls}/command/eva/1": (data, drop, False),
        f"{calls}/read/eva/1": (data, drop, False),
        f"{calls}/stop/eva/1": (zenoh.Priority.REAL_TIME, drop, True),
        f"colony/{ROBOT}/RServer/requests/eva": (zenoh.Priority.INTERACTIVE_HIGH, drop, False),
        frames: (data, drop, False),
    }


def test_the_largest_answer_gets_through(lab: _Lab) -> None:
    image = msgspec.Raw(msgspec.msgpack.encode(bytes(codec.LARGEST - 1024)))

    def answer(message: Message, now_ns: int) -> Iterator[Effect]:
        if isinstance(message, Call):
            reply = Reply(connection=message.connection, number=message.number, result=image)
            yield Send(topics.replies("CServer", message.connection), reply)

    heard: list[object] = []
    node = Recorder("CServer", topics.calls("CServer"), on=answer)
    with hosted(lab.environment, [node]), _remote(lab, "ada") as ada:
        _listen(ada, keys.listening(ROBOT, "CServer/reply/ada/1"), heard)

        def asked() -> bool:
            _put(
                ada,
                f"colony/{ROBOT}/CServer/call/read/ada/1",
                codec.encode(plain_call("ada/1", right="read")),
            )
            return bool(heard)

        until(asked, "the answer, perhaps to the second call")
    assert isinstance(heard[0], Reply)
    assert len(heard[0].result) == len(image)


def test_a_user_who_does_not_read_holds_up_nobody(lab: _Lab) -> None:
    frames = f"colony/{ROBOT}/RServer/frames"
    frozen, heard, lost = threading.Event(), list[int](), list[str]()
    with (
        Network.open(place(lab.environment), listens=("RServer",)) as robot,
        _remote(lab, "bob") as bob,
        _remote(lab, "ada") as ada,
        publish(robot.session, frames) as publisher,
    ):
        _note(ada, frames, lambda sample: heard.append(len(sample.payload)))
        _note(bob, frames, lambda sample: frozen.wait(20))
        try:
            until(lambda: "Gateway" in robot.alive() and _heard(publisher, heard), "it is linked")
            robot.watch(lambda address, present: None if present else lost.append(address))
            for _ in range(100):
                publisher.put(bytes(256 * 1024))
            until(lambda: _heard(publisher, heard), "what comes after that")
        finally:
            frozen.set()
    assert lost == []


def _heard(publisher: zenoh.Publisher, heard: list[int]) -> bool:
    """Send a small one; whether the newest that was heard is such a one."""
    publisher.put(b"small")
    return heard[-1:] == [5]


def _remote(lab: _Lab, user: str) -> Network:
    return Network.open(lab.remote(user))


def _note(network: Network, key: str, take: Callable[[zenoh.Sample], None]) -> None:
    network.session.declare_subscriber(key, zenoh.handlers.Callback(take, indirect=False))


def _urgent(network: Network, key: str) -> None:
    with publish(network.session, key, haste=Haste.STOP) as publisher:
        until(lambda: publisher.matching_status.matching, f"nobody listens to {key}")  # type: ignore[attr-defined]
        publisher.put(b"x")


def test_a_gateway_whose_memory_is_full_begins_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As the same process, for a supervisor or a person who started it."""
    used = [46 << 20]
    node = GatewayNode(read_security(Authority(tmp_path).table(USERS)), memory=lambda: used[0])
    (wake,) = node.start(0)
    assert isinstance(wake, WakeAt)
    used[0] += gateway.GROWTH_BYTES
    assert list(node.handle(Wake(), wake.t_ns)) == [WakeAt(2 * wake.t_ns)]
    used[0] += 1 << 20
    assert list(node.handle(Wake(), 2 * wake.t_ns - 1)) == [], "not looked at yet"
    with pytest.raises(GatewayFull, match="Gateway: 111 MiB of memory are used; expected at most 110"):
        list(node.handle(Wake(), 2 * wake.t_ns))


def test_it_is_the_same_command_that_begins_again(monkeypatch: pytest.MonkeyPatch) -> None:
    began: list[list[str]] = []
    monkeypatch.setattr(child.os, "execv", lambda program, arguments: began.append([program, *arguments]))
    monkeypatch.setattr(child.sys, "orig_argv", ["python", "-P", "-m", "module", "spec.json"])
    child.begin_again()
    assert began == [[sys.executable, sys.executable, "-P", "-m", "module", "spec.json"]]
