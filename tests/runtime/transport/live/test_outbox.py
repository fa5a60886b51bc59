"""How messages leave a process: publishers that are kept, and those that are given back."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import zenoh

from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.messages import Reply, Tick
from colony.runtime.transport.live import keys, outbox
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.outbox import IDLE_NS, Outbox
from tests.runtime.transport.live.stage import ROBOT, robot_address, run_directory
from tests.waiting import until


@pytest.fixture
def network() -> Iterator[ZenohSession]:
    with run_directory() as environment, ZenohSession.open(robot_address(environment)) as made:
        yield made


def _reply(box: Outbox, connection: str, now_ns: int) -> None:
    reply = Reply(connection=connection, number=1)
    box.send(topics.replies("RServer", connection), reply, now_ns)


def test_publishers_for_connections_are_given_back_when_they_are_idle(network: ZenohSession) -> None:
    box = Outbox(network.session, ROBOT, lambda problem: None, user="u")
    _reply(box, "u/1", 0)
    _reply(box, "u/2", 0)
    _reply(box, "u/1", IDLE_NS)
    assert len(box._connection_publishers) == 2
    _reply(box, "u/3", IDLE_NS + 1)
    assert [key.rsplit("/", 1)[1] for key in box._connection_publishers] == ["1", "3"]


def test_there_are_never_too_many_of_them(network: ZenohSession, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outbox, "MAX_CONNECTION_PUBLISHERS", 3)
    box = Outbox(network.session, ROBOT, lambda problem: None, user="u")
    for n in range(10):
        _reply(box, f"u/{n}", n)
    assert [key.rsplit("/", 1)[1] for key in box._connection_publishers] == ["7", "8", "9"]


def test_what_is_sent_is_heard_also_when_its_publisher_was_given_back(network: ZenohSession) -> None:
    heard: list[object] = []
    handler = zenoh.handlers.Callback(
        lambda sample: heard.append(codec.decode(sample.payload.to_bytes())), indirect=False
    )
    network.session.declare_subscriber(
        keys.subscription_key(ROBOT, topics.replies("RServer", "u/1")), handler
    )
    network.session.declare_subscriber(keys.subscription_key(ROBOT, topics.TICKS), handler)
    box = Outbox(network.session, ROBOT, lambda problem: None, user="u")
    for now_ns in (0, 2 * IDLE_NS, 4 * IDLE_NS):
        _reply(box, "u/1", now_ns)
        _reply(box, "u/2", now_ns + IDLE_NS + 1)
    box.send(topics.TICKS, Tick(k=1, t_ns=1), 0)
    until(lambda: len(heard) == 4, "all is heard")
    assert heard == [Reply(connection="u/1", number=1)] * 3 + [Tick(k=1, t_ns=1)]
