"""What a gateway lets through: how large, how urgent, how often, and past whom who does not read."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import msgspec
import pytest
import zenoh

from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.messages import (
    MAX_BATCH_LENGTH,
    Alive,
    Call,
    Effect,
    Message,
    Ready,
    Reply,
    Request,
    SendMessage,
)
from colony.runtime.transport.live import keys, limits
from colony.runtime.transport.live.limits import MEDIUM_MESSAGE_BYTES, Rate
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.outbox import Outbox, SendPriority, declare_publisher
from tests.kit.calling import plain_call
from tests.runtime.transport.live.gateway_lab import Lab, listen, note, put
from tests.runtime.transport.live.stage import ROBOT, Recorder, hosted, python_process, robot_address
from tests.waiting import until


def test_nothing_comes_twice_and_servers_that_come_later_are_found(lab: Lab) -> None:
    """All are linked to each other and to the gateway; with gossip for some, and without for the gateway."""
    call = plain_call("bob/1", right="read")
    with (
        ZenohSession.open(robot_address(lab.environment)) as at_home,
        lab.session("bob") as session,
        ZenohSession.open(lab.remote("bob")) as remote,
        hosted(lab.environment, [Recorder("Clock", topics.calls("Clock"))]),
    ):
        until(lambda: {"Clock", "Gateway"} <= set(at_home.alive()), "it is linked to others")
        node = Recorder("Radio", topics.calls("Radio"))
        with hosted(lab.environment, [node]):
            until(lambda: "Radio" in at_home.alive(), "a name that nobody knew, by gossip")
            until(lambda: "Radio" in session.servers(), "and from behind the gateway")
            for network in (at_home, remote):
                put(network, f"colony/{ROBOT}/Radio/call/read/bob/1", codec.encode(call))
            put(remote, f"colony/{ROBOT}/Radio/call/read/bob/1", codec.encode(Alive(connection="bob/1")))
            until(lambda: any(isinstance(m, Alive) for m in node.got), "the last one")
            assert node.got.count(call) == 2
    assert len(node.got) == 3


@pytest.mark.parametrize(
    ("user", "right", "limit"),
    [("carl", "stop", 1024), ("bob", "read", MEDIUM_MESSAGE_BYTES), ("ada", "command", None)],
)
def test_messages_larger_than_their_right_allows(lab: Lab, user: str, right: str, limit: int | None) -> None:
    sizes: list[int] = []
    key = f"colony/{ROBOT}/RServer/call/{right}/{user}/1"
    with (
        ZenohSession.open(robot_address(lab.environment), server_names=("RServer",)) as robot,
        ZenohSession.open(lab.remote(user)) as network,
    ):
        note(robot, key, lambda sample: sizes.append(len(sample.payload)))
        put(network, key, b"small")
        until(lambda: sizes == [5], "the small one")
        if limit is not None:
            put(network, key, bytes(limit + 1))
        put(network, key, bytes(limit or codec.MAX_MESSAGE_BYTES))
        until(lambda: len(sizes) == 2, "the largest one")
    assert sizes == [5, limit or codec.MAX_MESSAGE_BYTES]


def test_users_choose_no_priority_and_nobody_waits_for_them(lab: Lab) -> None:
    found: dict[str, tuple[object, object, bool]] = {}

    def keep(sample: zenoh.Sample) -> None:
        found[str(sample.key_expr)] = (sample.priority, sample.congestion_control, sample.express)

    drop, data = zenoh.CongestionControl.DROP, zenoh.Priority.DATA
    calls = f"colony/{ROBOT}/RServer/call"
    frames = f"colony/{ROBOT}/RServer/frames"
    with (
        ZenohSession.open(robot_address(lab.environment), server_names=("RServer",)) as robot,
        ZenohSession.open(lab.remote("eva")) as network,
    ):
        note(robot, f"{calls}/**", keep)
        note(robot, f"colony/{ROBOT}/RServer/requests/*", keep)
        note(network, frames, keep)
        _urgent(network, f"{calls}/command/eva/1")
        _urgent(network, f"{calls}/read/eva/1")
        put(network, f"{calls}/stop/eva/1", b"x")
        put(network, f"colony/{ROBOT}/RServer/requests/eva", b"x")
        put(robot, frames, b"x")
        until(lambda: len(found) == 5, "all came")
    assert found == {
        f"{calls}/command/eva/1": (data, drop, False),
        f"{calls}/read/eva/1": (data, drop, False),
        f"{calls}/stop/eva/1": (zenoh.Priority.REAL_TIME, drop, True),
        f"colony/{ROBOT}/RServer/requests/eva": (zenoh.Priority.INTERACTIVE_HIGH, drop, False),
        frames: (data, drop, False),
    }


def test_the_largest_answer_gets_through(lab: Lab) -> None:
    image = msgspec.Raw(msgspec.msgpack.encode(bytes(codec.MAX_MESSAGE_BYTES - 1024)))

    def answer(message: Message, now_ns: int) -> Iterator[Effect]:
        if isinstance(message, Call):
            reply = Reply(connection=message.connection, number=message.number, result=image)
            yield SendMessage(topics.replies("CServer", message.connection), reply)

    heard: list[object] = []
    node = Recorder("CServer", topics.calls("CServer"), on=answer)
    with hosted(lab.environment, [node]), ZenohSession.open(lab.remote("ada")) as ada:
        listen(ada, keys.subscription_key(ROBOT, "CServer/reply/ada/1"), heard)

        def asked() -> bool:
            put(
                ada,
                f"colony/{ROBOT}/CServer/call/read/ada/1",
                codec.encode(plain_call("ada/1", right="read")),
            )
            return bool(heard)

        until(asked, "the answer, perhaps to the second call")
    assert isinstance(heard[0], Reply)
    assert len(heard[0].result) == len(image)


_READER = """
import sys
from pathlib import Path
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.robot_address import Credentials, Remote

robot, endpoint, user, certificate, key, authority, frames = sys.argv[1:]
credentials = Credentials(
    user=user, certificate=Path(certificate), key=Path(key), authority=Path(authority)
)
place = Remote(robot=robot, endpoint=endpoint, credentials=credentials)
with ZenohSession.open(place) as session:
    got = session.session.declare_subscriber(frames)
    got.recv()
    print("linked", flush=True)
    for frame in got:
        pass
"""


def test_a_user_who_does_not_read_holds_up_nobody(lab: Lab) -> None:
    """The user is a process that is stopped: in this one it would hold up zenoh's threads for all."""
    frames = f"colony/{ROBOT}/RServer/frames"
    heard, lost = list[int](), list[str]()
    bob = lab.remote("bob").credentials
    argv = (ROBOT, lab.endpoint, bob.user, str(bob.certificate), str(bob.key), str(bob.authority), frames)
    with (
        ZenohSession.open(robot_address(lab.environment), server_names=("RServer",)) as robot,
        ZenohSession.open(lab.remote("ada")) as ada,
        declare_publisher(robot.session, frames) as publisher,
        sending(publisher),
        python_process({}, "-c", _READER, *argv, says="linked") as reader,
    ):
        note(ada, frames, lambda sample: heard.append(len(sample.payload)))
        until(lambda: "Gateway" in robot.alive() and _heard(publisher, heard), "it is linked")
        reader.send_signal(signal.SIGSTOP)
        robot.watch(lambda address, present: None if present else lost.append(address))
        for _ in range(100):
            publisher.put(bytes(256 * 1024))
        until(lambda: _heard(publisher, heard), "what comes after that")
    assert lost == []


@contextmanager
def sending(publisher: zenoh.Publisher) -> Iterator[None]:
    """Send small ones meanwhile, ten a second."""
    ended = threading.Event()

    def send() -> None:
        while not ended.wait(0.1):
            publisher.put(b"small")

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _heard(publisher: zenoh.Publisher, heard: list[int]) -> bool:
    """Send a small one; whether the newest that was heard is such a one."""
    publisher.put(b"small")
    return heard[-1:] == [5]


def _urgent(network: ZenohSession, key: str) -> None:
    with declare_publisher(network.session, key, priority=SendPriority.STOP) as publisher:
        until(lambda: publisher.matching_status.matching, f"nobody listens to {key}")  # type: ignore[attr-defined]
        publisher.put(b"x")


def test_the_largest_batches_of_clients_get_through_and_are_counted_by_their_messages(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As large as a process of a thousand clients with long names sends them, in each of some frames."""
    monkeypatch.setattr(limits, "PROGRAM_RATE", Rate(per_s=0.0, burst=3 * (2 * MAX_BATCH_LENGTH + 30)))
    clients = [f"{'c' * 150}{i}" for i in range(MAX_BATCH_LENGTH)]
    frames = [
        [
            *(SendMessage(topics.requests("RServer"), _asks(k, client)) for client in clients),
            *(SendMessage(topics.READY, Ready(client=client, run="run", k=k)) for client in clients),
        ]
        for k in range(4)
    ]
    node = Recorder("RServer", topics.requests("RServer"), topics.READY)
    with hosted(lab.environment, [node]), ZenohSession.open(lab.remote("eva")) as network:
        until(lambda: "RServer" in network.alive(), "it is there")
        reports: list[str] = []
        box = Outbox(network.session, ROBOT, reports.append, user="eva")
        for sends in frames[:3]:
            for batch in (sends[:MAX_BATCH_LENGTH], sends[MAX_BATCH_LENGTH:]):
                _send_until_heard(box, batch, node)
        before = len(node.got)
        box.send_all(frames[3], 0)
        box.send_all([SendMessage(topics.READY, Ready(client="one more", run="run"))], 0)
        until(lambda: Ready(client="one more", run="run") in node.got, "there is room for one more")
    assert node.got[before:] == [Ready(client="one more", run="run")], "but not for a whole batch"
    assert not reports


def _send_until_heard(box: Outbox, batch: list[SendMessage], node: Recorder) -> None:
    """Send again what a busy machine dropped, as it may drop any message of a frame, and that alone."""
    before = len(node.got)
    missing = batch
    for _ in range(20):
        box.send_all(missing, 0)
        with suppress(AssertionError):
            until(lambda: len(node.got) >= before + len(batch), "all of the batch is heard", patience_s=10.0)
            break
        heard = set(node.got[before:])
        missing = [send for send in batch if send.message not in heard]
    assert len(node.got) == before + len(batch)


def _asks(k: int, client: str) -> Request:
    return Request(k=k, actuator="drive", client=client, bid="silent")
