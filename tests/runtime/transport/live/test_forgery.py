"""Messages where they do not belong: a topic takes only its own kinds, no name breaks a server, and who may
only read cannot put a call of somebody else anywhere."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
import zenoh

from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.codec import MessageFormatError
from colony.runtime.protocol.messages import (
    Alive,
    Bounds,
    Call,
    Checkpoint,
    Fetch,
    Malformed,
    Message,
    Ready,
    Recall,
    Reply,
    Request,
    Right,
    SendMessage,
    SentMessage,
    ServerFrame,
    Tick,
)
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.keys import CallKey
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

    def answer(message: Message, now_ns: int) -> list[SendMessage]:
        name = message.client if isinstance(message, Recall) else "sane"
        return [SendMessage(topics.recall_answers("DServer", name), CHECKPOINT)]

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


# --- Topics as keys, and what the key of a call says ---


def _call(right: Right = "command", connection: str = "ada/7") -> Call:
    return Call(connection=connection, number=1, method="go", arguments=msgspec.Raw(b"\xc0"), right=right)


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        (topics.TICKS, Tick(k=1, t_ns=1)),
        (topics.frames("PServer"), Tick(k=1, t_ns=1)),
        (topics.replies("RServer", "ada/7"), Reply(connection="ada/7", number=1)),
        (topics.calls("RServer"), _call()),
        (topics.calls("RServer"), _call("stop")),
        (topics.calls("RServer"), Alive(connection="ada/7")),
        (topics.activity("DServer", "wander"), Tick(k=1, t_ns=1)),
        (topics.fetches("RServer"), Fetch(server="RServer", k=1)),
        (topics.READY, Ready(client="drive/cruise")),
    ],
)
def test_who_listens_to_a_topic_hears_what_is_sent_to_it_at_this_robot(
    topic: str, message: SentMessage
) -> None:
    key = zenoh.KeyExpr(keys.publication_key("rome", topic, message, user="ada"))
    assert zenoh.KeyExpr(keys.subscription_key("rome", topic)).includes(key)
    assert not zenoh.KeyExpr(keys.subscription_key("siena", topic)).intersects(key)


@pytest.mark.parametrize("topic", [topics.fetches("RServer"), topics.checkpoints("DServer"), topics.RESTARTS])
def test_what_clients_send_has_their_user_in_its_key(topic: str) -> None:
    key = keys.publication_key("rome", topic, Fetch(server="RServer", k=1), user="ada")
    assert key == f"colony/rome/{topic}/ada"
    assert keys.user_message_kind(topic) == topic.partition("/")[2]
    assert keys.user_message_kind(topics.frames("RServer")) is None


def test_the_key_of_a_call_says_whose_it_is_and_under_which_right() -> None:
    assert keys.call_key("colony/rome/RServer/call/stop/ada@lab/7") == CallKey("stop", "ada@lab/7")
    assert keys.call_key("colony/rome/RServer/call/fly/ada/7") is None
    assert keys.call_key("call/read") is None


@pytest.mark.parametrize(
    ("message", "says"),
    [
        (_call("command"), "claims the right to command"),
        (_call("read", "bob/7"), "claims the connection bob/7"),
        (Alive(connection="bob/7"), "claims the connection bob/7"),
        (Tick(k=1, t_ns=1), "found Tick; expected Call or Alive"),
    ],
)
def test_a_call_must_say_what_its_key_says(message: SentMessage, says: str) -> None:
    with pytest.raises(MessageFormatError, match=says):
        keys.check_call(message, CallKey("read", "ada/7"))


def test_bounds_come_where_requests_do_and_nowhere_else() -> None:
    bounds = Bounds(k=1, actuator="drive", low=(0.0,), high=(1.0,))
    assert keys.check_frame(bounds, topics.requests("RServer")) is bounds
    assert keys.user_message_kind(topics.requests("RServer")) == "requests"
    for topic in (topics.frames("RServer"), topics.VERDICTS, topics.TICKS, topics.READY):
        with pytest.raises(MessageFormatError, match="found Bounds"):
            keys.check_frame(bounds, topic)


def test_a_call_that_does_is_taken() -> None:
    assert keys.check_call(_call("read"), CallKey("read", "ada/7")) == _call("read")
