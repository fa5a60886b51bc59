"""Calls: typed arguments, done once, answered now or later, by callers that may die."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import msgspec
import pytest

from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol import calls
from colony.runtime.protocol.calls import (
    LATER,
    LEASE_NS,
    MAX_ARGUMENT_BYTES,
    CallDispatcher,
    CallId,
    NoArguments,
    Open,
    RefusedError,
    Status,
    method,
)
from colony.runtime.protocol.connections import ANSWER_BYTES_KEPT, ANSWERS_KEPT, Caller
from colony.runtime.protocol.messages import (
    Alive,
    Call,
    Effect,
    Malformed,
    Message,
    Notice,
    Reply,
    Right,
    SendMessage,
    Wake,
    WakeAt,
)
from tests.kit.calling import call_of
from tests.kit.node_stage import MS

ANN, BOB = "ann/1", "bob/2"


class Add(msgspec.Struct, frozen=True, kw_only=True):
    """What to add to the sum."""

    amount: int


class Sums:
    """A server with a sum that can be read and added to, and a question that it answers when told."""

    def __init__(self) -> None:
        self.sum = 0
        self.sent_large = b""
        self.asked: list[CallId] = []
        self.gone: list[Caller] = []
        self.banned = ""
        self.desk = CallDispatcher(
            "Sums",
            (
                method("sum", NoArguments, lambda *_: self.sum, right="read"),
                method("add", Add, self._add),
                method("large", NoArguments, lambda *_: self.sent_large),
                method("wait", NoArguments, self._wait, right="read"),
                method("halt", NoArguments, lambda *_: None, right="stop"),
                method("long", NoArguments, lambda *_: None, max_bytes=100_000),
                method("watch", NoArguments, lambda *_: None, right="read", lasting=True),
                method("fail", NoArguments, self._fail, right="read"),
            ),
            admit=self._admit,
            on_lost=self._lost,
        )
        self.wakes: list[int] = []

    def _add(self, asked: CallId, add: Add, now_ns: int) -> int:
        if add.amount < 0:
            raise RefusedError("negative", f"found {add.amount}; expected at least 0")
        self.sum += add.amount
        return self.sum

    def _fail(self, asked: CallId, arguments: NoArguments, now_ns: int) -> None:
        raise RefusedError("failed", "x" * 4_000_000)

    def _wait(self, asked: CallId, arguments: NoArguments, now_ns: int) -> object:
        self.asked.append(asked)
        return LATER

    def _admit(self, caller: Caller) -> None:
        if caller.name == self.banned:
            raise RefusedError("banned", f"{caller.name} may not come in")

    def _lost(self, caller: Caller, now_ns: int) -> Iterable[Effect]:
        self.gone.append(caller)
        return ()

    def tell(self, message: Message, now_ns: int = 0) -> list[Reply | Notice]:
        return self.sent(self.desk.handle(message, now_ns))

    def sent(self, effects: Iterable[Effect]) -> list[Reply | Notice]:
        out: list[Reply | Notice] = []
        for effect in effects:
            if isinstance(effect, WakeAt):
                self.wakes.append(effect.t_ns)
            else:
                assert effect.topic == f"Sums/reply/{effect.message.connection}"
                out.append(effect.message)
        return out

    def open(self, connection: str, now_ns: int = 0, priority: int = 0, name: str = "test") -> Reply:
        (reply,) = self.tell(call(connection, 1, "open", Open(name=name), priority=priority), now_ns)
        assert isinstance(reply, Reply)
        return reply


def call(
    connection: str,
    number: int,
    what: str,
    arguments: object = None,
    *,
    priority: int = 0,
    right: Right = "command",
) -> Call:
    return call_of(
        CallRequest(what, {} if arguments is None else arguments, None, right), connection, number, priority
    )


def result(replies: list[Any]) -> Any:
    (reply,) = replies
    assert reply.problem is None, reply.problem
    return msgspec.msgpack.decode(reply.result)


def code(replies: list[Any]) -> str:
    (reply,) = replies
    return str(reply.problem.code)


@pytest.fixture
def sums() -> Sums:
    server = Sums()
    server.open(ANN)
    return server


def test_a_call_and_its_reply(sums: Sums) -> None:
    assert result(sums.tell(call(ANN, 2, "add", Add(amount=5)))) == 5
    assert result(sums.tell(call(ANN, 3, "sum", right="read"))) == 5


def test_a_call_that_arrives_twice_is_done_once(sums: Sums) -> None:
    first = sums.tell(call(ANN, 2, "add", Add(amount=5)))
    assert sums.tell(call(ANN, 2, "add", Add(amount=5))) == first
    assert sums.sum == 5


def test_a_call_forgotten_is_not_done_again(sums: Sums) -> None:
    for number in range(2, ANSWERS_KEPT + 10):
        sums.tell(call(ANN, number, "add", Add(amount=1)))
    before = sums.sum
    assert sums.tell(call(ANN, 2, "add", Add(amount=1))) == []
    assert sums.sum == before


def test_large_answers_are_not_kept_for_long(sums: Sums) -> None:
    sums.sent_large = b"x" * (ANSWER_BYTES_KEPT // 3)
    for number in range(2, 7):
        assert result(sums.tell(call(ANN, number, "large"))) == sums.sent_large
    assert sums.tell(call(ANN, 3, "large")) == []
    assert result(sums.tell(call(ANN, 6, "large"))) == sums.sent_large
    sums.sent_large *= 6
    assert result(sums.tell(call(ANN, 7, "large"))) == result(sums.tell(call(ANN, 7, "large")))


def test_problems_say_what_was_found(sums: Sums) -> None:
    (reply,) = sums.tell(call(ANN, 2, "add", {"amount": "much"}))
    assert reply.problem.code == "arguments"
    assert reply.problem.message == "Sums.add: Expected `int`, got `str` - at `$.amount`"
    (reply,) = sums.tell(call(ANN, 3, "subtract"))
    assert reply.problem.message.startswith("Sums has no method `subtract`; it has open, close, status, sum")
    assert code(sums.tell(call(ANN, 4, "add", Add(amount=-1)))) == "negative"
    assert sums.sum == 0


@pytest.mark.parametrize(
    ("what", "right", "allowed"),
    [
        ("sum", "read", True),
        ("sum", "command", True),
        ("wait", "stop", True),
        ("halt", "stop", True),
        ("halt", "command", True),
        ("halt", "read", False),
        ("add", "read", False),
        ("add", "stop", False),
        ("sum", "unlimited", True),
        ("add", "unlimited", False),
    ],
)
def test_rights(sums: Sums, what: str, right: Right, allowed: bool) -> None:
    replies = sums.tell(call(ANN, 2, what, Add(amount=1), right=right))
    assert (not replies or replies[0].problem is None) == allowed  # type: ignore[union-attr]
    if not allowed:
        assert code(replies) == "right"


def test_arguments_that_are_no_msgpack(sums: Sums) -> None:
    bad = Call(connection=ANN, number=2, method="add", arguments=msgspec.Raw(b"\xc1"))
    assert code(sums.tell(bad)) == "arguments"
    opening = Call(connection=BOB, number=1, method="open", arguments=msgspec.Raw(b"\x81"))
    assert code(sums.tell(opening)) == "arguments"


@pytest.mark.parametrize(("method", "most"), [("add", MAX_ARGUMENT_BYTES), ("long", 100_000)])
def test_arguments_that_are_too_large_are_refused_before_they_are_decoded(
    sums: Sums, method: str, most: int
) -> None:
    def padded(size: int) -> msgspec.Raw:
        """A mapping of so many bytes with an amount, and a key that no method knows."""
        begin = (
            b"\x82" + msgspec.msgpack.encode("amount") + b"\x01" + msgspec.msgpack.encode("rest") + b"\xc6"
        )
        rest = size - len(begin) - 4
        return msgspec.Raw(begin + rest.to_bytes(4, "big") + bytes(rest))

    for number, size, expected in ((2, most, None), (3, most + 1, "size")):
        arguments = padded(size)
        assert len(memoryview(arguments)) == size
        (reply,) = sums.tell(Call(connection=ANN, number=number, method=method, arguments=arguments))
        assert (None if reply.problem is None else reply.problem.code) == expected


def test_who_is_not_connected(sums: Sums) -> None:
    assert code(sums.tell(call(BOB, 1, "sum"))) == "closed"
    assert code(sums.tell(Alive(connection=BOB))) == "closed"


def test_who_is_not_admitted(sums: Sums) -> None:
    sums.banned = "mallory"
    reply = sums.open(BOB, name="mallory")
    assert reply.problem.message == "mallory may not come in"
    assert code(sums.tell(call(BOB, 2, "sum"))) == "closed"


def test_the_priority_is_the_connections(sums: Sums) -> None:
    assert code(sums.tell(call(ANN, 2, "sum", priority=9))) == "arguments"
    assert sums.open(BOB, priority=9).problem is None
    for connection, priority in ((ANN, 0), (BOB, 9)):
        assert sums.tell(call(connection, 3, "wait", priority=priority)) == []
    callers = [asked.caller for asked in sums.asked]
    assert [(c.connection, c.priority, c.user) for c in callers] == [(ANN, 0, "ann"), (BOB, 9, "bob")]


def test_an_answer_that_comes_later(sums: Sums) -> None:
    assert sums.tell(call(ANN, 2, "wait")) == []
    assert sums.tell(call(ANN, 2, "wait")) == []  # still the same call
    (asked,) = sums.asked
    assert result(sums.sent(sums.desk.answer(asked, "now"))) == "now"
    assert result(sums.tell(call(ANN, 2, "wait"))) == "now"
    sums.tell(call(ANN, 3, "wait"))
    assert code(sums.sent(sums.desk.refuse(sums.asked[1], RefusedError("never", "no")))) == "never"


def test_notices(sums: Sums) -> None:
    sums.tell(call(ANN, 2, "wait"))
    caller = sums.asked[0].caller
    (notice,) = sums.sent(sums.desk.notify(caller, "weather", {"rain": True}))
    assert (notice.subject, msgspec.msgpack.decode(notice.body)) == ("weather", {"rain": True})
    sums.tell(call(ANN, 3, "close"))
    assert sums.sent(sums.desk.notify(caller, "weather", 1)) == []


def test_close(sums: Sums) -> None:
    sums.tell(call(ANN, 2, "close"))
    assert [c.connection for c in sums.gone] == [ANN]
    assert code(sums.tell(call(ANN, 3, "sum"))) == "closed"


def test_a_silent_connection_is_lost_after_its_lease() -> None:
    sums = Sums()
    sums.open(ANN)
    sums.open(BOB, 100 * MS)
    sums.tell(call(ANN, 2, "wait"))
    for t in range(200 * MS, 2 * LEASE_NS, 200 * MS):
        sums.tell(Alive(connection=BOB), t)
        while sums.wakes and min(sums.wakes) <= t:
            sums.wakes.remove(min(sums.wakes))
            sums.tell(Wake(), t)
        if t <= LEASE_NS:
            assert sums.gone == []
    assert [c.connection for c in sums.gone] == [ANN]
    assert sums.wakes, "Bob is still watched"
    assert sums.sent(sums.desk.answer(sums.asked[0], "too late")) == []
    assert code(sums.tell(call(ANN, 3, "sum"), 2 * LEASE_NS)) == "closed"


def test_an_empty_desk_asks_for_no_wakes() -> None:
    sums = Sums()
    sums.open(ANN)
    sums.tell(call(ANN, 2, "close"))
    for t in sums.wakes.copy():
        sums.wakes.clear()
        sums.tell(Wake(), t)
    assert sums.wakes == []


def test_malformed_messages_are_answered_and_counted(sums: Sums) -> None:
    topic = "Sums/call"
    (reply,) = sums.tell(Malformed(topic=topic, connection=BOB, reason="found version 7"))
    assert (reply.connection, reply.number) == (BOB, 0)
    assert code([reply]) == "malformed"
    assert sums.tell(Malformed(topic=topic, connection=None, reason="noise")) == []
    sums.tell(call(ANN, 2, "subtract"))
    status = msgspec.convert(result(sums.tell(call(ANN, 3, "status", right="read"))), Status)
    assert (status.malformed, status.last_malformed) == (2, "noise")
    (mine,) = status.connections
    assert (mine.connection, mine.calls, mine.problems) == (ANN, 3, 1)
    assert mine.last_problem is not None


def test_effects_are_lazy_but_complete(sums: Sums) -> None:
    """Whoever takes the effects one by one gets all of them."""
    effects = list(sums.desk.handle(call(ANN, 2, "sum"), 0))
    assert [type(e) for e in effects] == [SendMessage]


def test_the_right_to_stop_does_not_do_for_what_goes_on_to_cost_something(sums: Sums) -> None:
    sums.open("ada/1")
    assert code(sums.tell(call("ada/1", 2, "watch", right="stop"))) == "right"
    for number, right in ((3, "read"), (4, "command")):
        assert result(sums.tell(call("ada/1", number, "watch", right=right))) is None  # type: ignore[arg-type]


def test_what_is_read_is_not_kept_be_it_refused_or_not(sums: Sums) -> None:
    sums.open("ada/1")
    for number in range(2, 40):
        assert code(sums.tell(call("ada/1", number, "fail", right="read"))) == "failed"
        assert result(sums.tell(call("ada/1", 100 + number, "sum", right="read"))) == 0
        assert code(sums.tell(call("ada/1", 200 + number, "none of these", right="read"))) == "method"
    connection = sums.desk._connections["ada/1"]
    assert (len(connection.answers), connection.answer_bytes) == (0, 0)


def test_no_text_of_a_caller_makes_a_status_too_large(sums: Sums) -> None:
    sums.open("ada/1")
    sums.tell(call("ada/1", 2, "fail", right="read"))
    sums.tell(call("ada/1", 3, "m" * 4_000_000, right="read"))
    sums.tell(Malformed(topic="Sums/call", connection="ada/1", reason="r" * 4_000_000))
    status = result(sums.tell(call("ada/1", 4, "status", right="read")))
    assert len(msgspec.msgpack.encode(status)) < 10_000
    assert status["malformed"] == 1


def test_answers_of_all_connections_have_an_end(sums: Sums, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(calls, "MAX_ANSWER_BYTES", 10_000)
    for number in range(20):
        sums.open(f"ada/{number}")
        for call_number in range(2, 10):
            sums.tell(call(f"ada/{number}", call_number, "add", Add(amount=1)))
    assert sum(c.answer_bytes for c in sums.desk._connections.values()) <= 10_000
    status = result(sums.tell(call("ada/19", 10, "status", right="read")))
    assert status["full"] == ["Sums keeps 0 MiB of answers, and forgets the oldest"]
    for number in range(20):
        sums.tell(call(f"ada/{number}", 20, "close", right="read"))
    assert sums.desk._answer_bytes == 0
