"""Messages where they do not belong: a topic takes only its own kinds, no name breaks a server, and who may
only read cannot put a call of somebody else anywhere."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.codec import MessageFormatError
from colony.runtime.protocol.messages import (
    Alive,
    Call,
    Checkpoint,
    Fetch,
    Malformed,
    Message,
    Recall,
    Reply,
    Request,
    Send,
    SentMessage,
    ServerFrame,
    Tick,
)
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.robot_address import local
from tests.runtime.transport.live.gateway_lab import Lab, put
from tests.runtime.transport.live.stage import ROBOT, Recorder, hosted, run_directory
from tests.waiting import until

_NOTHING = msgspec.Raw(msgspec.msgpack.encode({}))
CALL = Call(connection="ada/1", number=1, method="drive", arguments=_NOTHING)
CHECKPOINT = Checkpoint(client="drive/frames", k=1, start=0, memory=b"")
FRAME = ServerFrame(server="PServer", k=1, fields={})
TICK = Tick(k=1, t_ns=1)

FITS: list[tuple[str, SentMessage]] = [
    (topics.TICKS, TICK),
    (topics.frames("PServer"), FRAME),
    (topics.frames(topics.CLOCK), TICK),
    (topics.frames(topics.activity("DServer", "fetches")), FRAME),
    (topics.fetches("PServer"), Fetch(server="PServer", k=1)),
    (topics.checkpoints("DServer"), Recall(client="drive/cruise")),
    (topics.recall_answers("DServer", "drive/frames"), CHECKPOINT),
    (topics.replies("DServer", "ada/frames"), Reply(connection="ada/frames", number=1)),
    ("anything/of/others", TICK),
]


@pytest.mark.parametrize(("topic", "message"), FITS, ids=[topic for topic, _ in FITS])
def test_a_topic_takes_its_own_kinds(topic: str, message: SentMessage) -> None:
    assert keys.check_frame(message, topic) == message
    for call in (CALL, Alive(connection="ada/1")):
        with pytest.raises(MessageFormatError, match=rf"found {type(call).__name__}; expected "):
            keys.check_frame(call, topic)


@pytest.mark.parametrize("topic", ["RServer/fetches", "RServer/frames", "Clock/ticks", "verdicts"])
def test_and_no_others(topic: str) -> None:
    request = Request(k=1, actuator="drive", client="cruise", bid="command", values=(1.0, 0.0))
    with pytest.raises(MessageFormatError, match="found Request; expected "):
        keys.check_frame(request, topic)


def test_a_call_on_a_topic_of_frames_is_malformed() -> None:
    node = Recorder("RServer", topics.fetches("RServer"), topics.calls("RServer"))
    with (
        run_directory() as environment,
        hosted(environment, [node]),
        ZenohSession.open(local(ROBOT, environment)) as network,
    ):
        put(network, f"colony/{ROBOT}/RServer/fetches/bob", codec.encode(CALL))
        until(lambda: bool(node.got), "it is told of")
    (found,) = node.got
    assert isinstance(found, Malformed)
    assert found.connection is None
    assert found.reason == "found Call; expected Fetch"


@pytest.mark.parametrize("client", ["", "/", "a//b", "a#b", "$x", "*", "**", "drive/"])
def test_no_name_that_somebody_gives_breaks_a_server(client: str) -> None:
    reports: list[str] = []

    def answer(message: Message, now_ns: int) -> list[Send]:
        name = message.client if isinstance(message, Recall) else "sane"
        return [Send(topics.recall_answers("DServer", name), CHECKPOINT)]

    node = Recorder("DServer", topics.checkpoints("DServer"), on=answer)
    with (
        run_directory() as environment,
        hosted(environment, [node], report=reports.append),
        ZenohSession.open(local(ROBOT, environment)) as network,
    ):
        for name in (client, "drive/cruise"):
            put(network, f"colony/{ROBOT}/DServer/checkpoints/bob", codec.encode(Recall(client=name)))
        until(lambda: len(node.got) == 2, "it lives")
    assert len(reports) == (client not in ("*", "**"))


def test_who_may_only_read_cannot_call_in_the_name_of_another(lab: Lab) -> None:
    got: list[Any] = []
    node = Recorder("RServer", topics.calls("RServer"), topics.fetches("RServer"))
    with hosted(lab.environment, [node]), ZenohSession.open(lab.remote("bob")) as network:
        until(lambda: "RServer" in network.alive(), "the gateway found the server")
        for connection in ("ada/fetches", "ada/frames", "bob/fetches"):
            call = msgspec.structs.replace(CALL, connection=connection)
            network.session.put(f"colony/{ROBOT}/RServer/call/command/{connection}", codec.encode(call))
        put(network, f"colony/{ROBOT}/RServer/fetches/bob", codec.encode(CALL))
        honest = Fetch(server="RServer", k=7)
        put(network, f"colony/{ROBOT}/RServer/fetches/bob", codec.encode(honest))
        until(lambda: honest in node.got, "the honest one")
        got = list(node.got)
    assert [m for m in got if isinstance(m, (Call, Alive))] == []
    assert [m.reason for m in got if isinstance(m, Malformed)] == ["found Call; expected Fetch"]
