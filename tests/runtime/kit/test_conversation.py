"""The client's end of a connection, message by message."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import count

import msgspec
import pytest

from colony.runtime.kit.conversation import (
    FIRST_RESEND_PAUSE_NS,
    KEEPALIVE_NS,
    Conversation,
    ConversationState,
    Deliver,
    Effect,
    Listen,
    Outcome,
    Pending,
    Resolve,
    Transmit,
)
from colony.runtime.kit.errors import CallRefusedError, ConnectionLostError
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import EMERGENCY_STOP, NoArguments
from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES
from colony.runtime.protocol.messages import Alive, Call, Notice, Problem, Reply
from tests.kit.node_stage import MS


class _Blob(msgspec.Struct, frozen=True, kw_only=True):
    data: bytes


def _conversation() -> Conversation:
    numbers = count(1)
    return Conversation(
        server="RServer", user="ada", new_id=lambda: str(next(numbers)), name="joystick", priority=5
    )


def _pending(method: str, outcomes: list[Outcome], *, repeatable: bool = False) -> Pending:
    ask: CallRequest[None] = CallRequest(method, NoArguments(), None, "command", repeatable=repeatable)
    return Pending(ask, outcomes.append)


def _calls(effects: Iterable[Effect]) -> list[Call]:
    messages = [effect.message for effect in effects if isinstance(effect, Transmit)]
    return [message for message in messages if isinstance(message, Call)]


def _resolve(effects: Iterable[Effect]) -> list[Effect]:
    """Do what the effects say about outcomes; gives the others."""
    rest: list[Effect] = []
    for effect in effects:
        if isinstance(effect, Resolve):
            effect.pending.resolve(effect.outcome)
        else:
            rest.append(effect)
    return rest


def _closed(connection: str, number: int = 0) -> Reply:
    return Reply(connection=connection, number=number, problem=Problem(code="closed", message="lost"))


def _open(talk: Conversation, now_ns: int = 0) -> None:
    opened: list[Outcome] = []
    _resolve(talk.open(opened.append, now_ns))
    _resolve(talk.receive(Reply(connection=talk.connection, number=1), now_ns))
    assert talk.state is ConversationState.OPEN
    assert len(opened) == 1


def test_it_opens_with_a_call_and_then_calls_are_answered_by_number() -> None:
    talk, opened = _conversation(), list[Outcome]()
    begin, transmit = talk.open(opened.append, 0)
    assert begin == Listen("ada/1")
    assert isinstance(transmit.message, Call)
    call = transmit.message
    assert (call.connection, call.number, call.method, call.priority, call.right) == (
        "ada/1",
        1,
        "open",
        5,
        "read",
    )
    outcomes: list[Outcome] = []
    assert not list(talk.submit(_pending("go", outcomes), 0)), "it waits until the connection is open"
    opening = _resolve(talk.receive(Reply(connection="ada/1", number=1), 0))
    assert [(c.number, c.method, c.right) for c in _calls(opening)] == [(2, "go", "command")]
    (second,) = _calls(talk.submit(_pending("stop", outcomes), 0))
    assert second.number == 3
    result = msgspec.Raw(msgspec.msgpack.encode(7))
    _resolve(talk.receive(Reply(connection="ada/1", number=3, result=result), 0))
    assert outcomes == [result]
    refused = Reply(connection="ada/1", number=2, problem=Problem(code="locked", message="by bob"))
    _resolve(talk.receive(refused, 0))
    _resolve(talk.receive(refused, 0))
    problem = outcomes[1]
    assert (problem.code, str(problem), len(outcomes)) == ("locked", "by bob", 2)


def test_a_call_without_an_answer_is_sent_again_with_the_same_number_ever_less_often() -> None:
    talk = _conversation()
    _open(talk)
    (call,) = _calls(talk.submit(_pending("go", []), 0))
    sent = [t for t in range(0, 5001 * MS, 50 * MS) if call in _calls(talk.poll(t))]
    gaps = [(b - a) // MS for a, b in zip([0, *sent], sent, strict=False)]
    assert gaps == [250, 500, 1000, 2000]


def test_a_silent_connection_gives_signs_of_life() -> None:
    talk = _conversation()
    _open(talk)
    alive = Transmit(Alive(connection="ada/1"))
    assert not list(talk.poll(KEEPALIVE_NS - 1))
    assert list(talk.poll(KEEPALIVE_NS)) == [alive]
    _calls(talk.submit(_pending("go", []), KEEPALIVE_NS + 1))
    assert alive not in list(talk.poll(2 * KEEPALIVE_NS))


def test_when_the_server_does_not_know_us_any_more_it_opens_anew_and_numbers_on() -> None:
    talk, outcomes = _conversation(), list[Outcome]()
    _open(talk)
    kept: CallRequest[None] = CallRequest("watch", NoArguments(), None, "read")
    talk.repeat_on_reopen(kept)
    list(talk.submit(_pending("read", outcomes, repeatable=True), 0))
    list(talk.submit(_pending("go", outcomes), 0))
    effects = _resolve(talk.receive(_closed("ada/1"), 0))
    assert isinstance(outcomes[0], ConnectionLostError)
    assert len(outcomes) == 1
    assert [(c.connection, c.number, c.method) for c in _calls(effects)] == [("ada/1", 4, "open")]
    assert not list(talk.receive(_closed("ada/1", 2), 0)), "it answers what was said before it was known"
    again = _calls(_resolve(talk.receive(Reply(connection="ada/1", number=4), 0)))
    assert [(c.number, c.method) for c in again] == [(5, "watch"), (2, "read")], "the same call, once"
    assert talk.openings == 2
    _resolve(talk.receive(Reply(connection="ada/1", number=2), 0))
    assert len(outcomes) == 2


def test_when_the_server_dies_only_calls_that_may_be_repeated_go_on_waiting() -> None:
    talk, outcomes = _conversation(), list[Outcome]()
    _open(talk)
    list(talk.submit(_pending("go", outcomes), 0))
    (read,) = _calls(talk.submit(_pending("read", outcomes, repeatable=True), 0))
    _resolve(talk.server_lost())
    assert [type(outcome) for outcome in outcomes] == [ConnectionLostError]
    assert list(talk.server_found(0)) == [Transmit(Alive(connection="ada/1"))]
    assert _calls(talk.poll(FIRST_RESEND_PAUSE_NS)) == [read]


def test_a_server_that_appears_is_asked_at_once_to_open() -> None:
    talk = _conversation()
    opening = _calls(talk.open(lambda outcome: None, 0))
    assert _calls(talk.server_found(MS)) == opening


def test_a_refused_opening_is_told_and_tried_again() -> None:
    talk, opened = _conversation(), list[Outcome]()
    list(talk.open(opened.append, 0))
    refusal = Reply(connection="ada/1", number=1, problem=Problem(code="full", message="1000 connections"))
    _resolve(talk.receive(refusal, 0))
    assert isinstance(opened[0], CallRefusedError)
    assert (talk.state, talk.server_error) == (ConversationState.OPENING, "1000 connections")
    assert len(_calls(talk.poll(FIRST_RESEND_PAUSE_NS))) == 1


def test_what_the_server_tells_and_complains_of() -> None:
    talk = _conversation()
    _open(talk)
    notice = Notice(connection="ada/1", subject="goal", body=msgspec.Raw(b"\xc0"))
    assert list(talk.receive(notice, 0)) == [Deliver(notice)]
    problem = Problem(code="malformed", message="no message")
    assert not list(talk.receive(Reply(connection="ada/1", number=0, problem=problem), 0))
    assert talk.server_error == "no message"


def test_closing_tells_the_server_and_whoever_waits() -> None:
    talk, outcomes = _conversation(), list[Outcome]()
    _open(talk)
    list(talk.submit(_pending("go", outcomes), 0))
    effects = _resolve(talk.close(0))
    assert [c.method for c in _calls(effects)] == ["close"]
    _resolve(talk.submit(_pending("go", outcomes), 0))
    assert [type(outcome) for outcome in outcomes] == [ConnectionLostError] * 2
    assert not [
        *talk.close(0),
        *talk.poll(10**12),
        *talk.reopen(0),
        *talk.server_lost(),
        *talk.server_found(0),
    ]


def test_who_gave_up_waiting_is_not_told() -> None:
    talk, outcomes = _conversation(), list[Outcome]()
    unsent = _pending("early", outcomes)
    list(talk.submit(unsent, 0))
    _open(talk)
    pending = _pending("go", outcomes)
    (call,) = _calls(talk.submit(pending, 0))
    talk.forget(pending)
    talk.forget(pending)
    assert not list(talk.receive(Reply(connection="ada/1", number=call.number), 0))


def test_arguments_that_are_too_large_are_refused_before_anything_is_sent() -> None:
    ask: CallRequest[None] = CallRequest("write", _Blob(data=bytes(MAX_MESSAGE_BYTES)), None, "command")
    with pytest.raises(
        CallRefusedError, match=r"write: the arguments are [0-9]+ bytes; expected at most 4193280"
    ):
        Pending(ask, lambda outcome: None)


def test_a_call_is_sent_again_before_its_time_as_long_as_it_has_no_answer() -> None:
    talk = Conversation(server="S", user="ada", new_id=iter(("1",)).__next__, name="n", priority=0)
    pending = Pending(
        CallRequest(EMERGENCY_STOP, NoArguments(), type(None), "stop", repeatable=True), lambda outcome: None
    )
    assert list(talk.resend(pending, 0)) == [], "not sent yet"
    list(talk.open(lambda outcome: None, 0))
    (first,) = talk.submit(pending, 1)
    assert isinstance(first, Transmit), "it does not wait until the connection is open"
    assert list(talk.resend(pending, 2)) == [first], "with the same number"
    list(talk.receive(Reply(connection="ada/1", number=first.message.number), 3))
    assert list(talk.resend(pending, 4)) == []


def test_a_call_that_was_refused_as_one_too_many_is_sent_again() -> None:
    talk = Conversation(server="S", user="ada", new_id=iter(("1",)).__next__, name="n", priority=0)
    list(talk.open(lambda outcome: None, 0))
    list(talk.receive(Reply(connection="ada/1", number=1), 0))
    outcomes: list[object] = []
    (sent,) = talk.submit(Pending(CallRequest("m", NoArguments(), type(None), "read"), outcomes.append), 0)
    flood = Problem(code="flood", message="too many")
    assert list(talk.receive(Reply(connection="ada/1", number=sent.message.number, problem=flood), 1)) == []
    assert (outcomes, talk.server_error) == ([], "too many")
    assert sent in list(talk.poll(300_000_000))
