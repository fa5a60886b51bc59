"""Topics as keys, and what the key of a call says."""

from __future__ import annotations

import msgspec
import pytest
import zenoh

from colony.runtime.protocol import topics
from colony.runtime.protocol.codec import MessageFormatError
from colony.runtime.protocol.messages import (
    Alive,
    Bounds,
    Call,
    Fetch,
    Ready,
    Reply,
    Right,
    SentMessage,
    Tick,
)
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.keys import CallKey


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
