"""A call is done once: though it arrives again, though its connection was lost, though the server died."""

from __future__ import annotations

from typing import Any

import pytest

from colony.runtime.library import data
from colony.runtime.library.ask import CallRequest
from colony.runtime.servers.call_answers import ANSWERS_PER_CONNECTION, MAX_CONNECTIONS, CallAnswers
from colony.runtime.store.store import Journal, MemoryStore
from tests.kit.node_stage import Caller, CallError, S, settle


def again(connection: Caller) -> None:
    """The server dies, is started anew, and the connection is opened again."""
    connection.stage.kill_and_restart()
    connection.open()


@pytest.mark.parametrize(
    ("ask", "other", "expected"),
    [
        (data.set("X", 1), data.set("X", 2), data.get("X")),
        (data.set_many({"X": 1}), data.set("X", 2), data.get("X")),
        (data.delete("X"), data.set("X", 2), data.get("X")),
        (data.set_history("X", 5), data.set_history("X", 2), data.history("X")),
        (data.create_semaphore("S", 4), data.delete_semaphore("S"), data.semaphores()),
        (data.signal("T"), data.signal("T"), data.semaphore("T")),
        (data.wait("T"), data.signal("T"), data.semaphore("T")),
        (data.delete_semaphore("T"), data.create_semaphore("T"), data.semaphores()),
    ],
    ids=lambda ask: ask.method,
)
def test_what_was_done_is_answered_alike_and_not_done_again(
    ada: Caller, ask: CallRequest[Any], other: CallRequest[Any], expected: CallRequest[Any]
) -> None:
    ada.do(data.set_many({"X": 0}))
    ada.do(data.create_semaphore("T", 1))
    first = ada.do(ask)
    number = ada.number
    bob = ada.stage.connect("bob/1")
    bob.do(other)
    before = bob.do(expected)
    again(ada)
    assert ada.do(ask, number) == first
    assert ada.do(ask, number) == first
    assert ada.do(expected) == before


def test_a_call_that_was_not_committed_is_done_when_it_comes_again(ada: Caller) -> None:
    ada.do(data.create_semaphore("S", 0))
    call = ada.call(data.signal("S"))
    list(ada.stage.node.handle(call, ada.stage.now_ns))  # and dies before it settles
    again(ada)
    ada.do(data.signal("S"), call.number)
    assert ada.do(data.semaphore("S")).value == 1


def test_a_call_refused_may_succeed_later(ada: Caller) -> None:
    with pytest.raises(CallError):
        ada.do(data.signal("S"))
    number = ada.number
    ada.do(data.create_semaphore("S", 0))
    again(ada)
    ada.do(data.signal("S"), number)
    assert ada.do(data.semaphore("S")).value == 1


def test_a_lost_connection_that_is_opened_again_goes_on(ada: Caller) -> None:
    ada.do(data.create_semaphore("S", 0))
    ada.do(data.signal("S"))
    number = ada.number
    ada.stage.pass_time(S)
    ada.open()
    ada.do(data.signal("S"), number)
    assert ada.do(data.semaphore("S")).value == 1


def test_connections_do_not_share_numbers(ada: Caller) -> None:
    ada.do(data.create_semaphore("S", 0))
    bob = ada.stage.connect("bob/1")
    for connection in (ada, bob):
        connection.do(data.signal("S"), 7)
    assert ada.do(data.semaphore("S")).value == 2


def test_a_call_from_too_far_back_is_refused(ada: Caller) -> None:
    ada.do(data.set("X", 0))
    number = ada.number
    for x in range(ANSWERS_PER_CONNECTION):
        ada.do(data.set("X", x))
    again(ada)
    with pytest.raises(CallError) as failed:
        ada.do(data.set("X", "again"), number)
    assert failed.value.code == "forgotten"
    ada.do(data.set("X", "in time"), number + 1)
    assert ada.do(data.get("X")) == ANSWERS_PER_CONNECTION - 1


def test_a_call_that_still_waits_is_never_too_far_back(ada: Caller) -> None:
    ada.do(data.create_semaphore("S", 0))
    ada.begin(data.wait("S"))
    number = ada.number
    for x in range(3 * ANSWERS_PER_CONNECTION):
        ada.do(data.set("X", x))
    for _ in range(2):
        again(ada)
        assert ada.replies(ada.begin(data.wait("S"), number)) == []
    effects = ada.begin(data.signal("S"))
    assert [r.number for r in ada.replies(effects)] == [ada.number, number]
    again(ada)
    ada.do(data.wait("S"), number)


@pytest.mark.parametrize("number", [0, -1, 1 << 53, 1 << 63, 1 << 64 - 1])
def test_impossible_numbers_are_refused(ada: Caller, number: int) -> None:
    effects = ada.begin(data.set("X", 1), number)
    assert [r.problem.code for r in ada.replies(effects) if r.problem] in (["arguments"], [])
    assert ada.do(data.names()) == ()


def test_old_connections_are_forgotten() -> None:
    store = MemoryStore()
    journal = Journal(store)
    answers = CallAnswers(journal)
    for i in range(MAX_CONNECTIONS + 1):
        answers.record(f"ada/{i}", 1, b"\xc0")
        answers.mark_pending(f"ada/{i}", 2)
    settle(journal)
    assert answers.find("ada/0", 1) is None
    assert answers.find("ada/1", 1) == b"\xc0"
    assert len(store.load()) == 2 * MAX_CONNECTIONS


def test_answers_that_were_taken_back_leave_no_gap_in_the_ring() -> None:
    store = MemoryStore()
    journal = Journal(store)
    answers = CallAnswers(journal)
    for number in range(1, 4 * ANSWERS_PER_CONNECTION):
        answers.record("ada/1", number, b"\xc0")
        if number % 5 == 0:
            answers.forget("ada/1", number - 2)
        settle(journal)
    loaded = CallAnswers(journal)
    loaded.load(dict(store.load()))
    for number in range(1, 4 * ANSWERS_PER_CONNECTION):
        found = []
        for one in (answers, loaded):
            try:
                found.append(one.find("ada/1", number))
            except Exception as problem:
                found.append(str(problem).encode())
        assert found[0] == found[1]
