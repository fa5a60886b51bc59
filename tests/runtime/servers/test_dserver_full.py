"""DServer on a full disk: what must be kept is refused before it is done, and everything else goes on."""

from __future__ import annotations

from typing import Any

import pytest

from colony.runtime.library import data
from colony.runtime.library.ask import STATUS, CallRequest
from colony.runtime.library.clock import deploy
from colony.runtime.protocol.messages import Verdict
from colony.runtime.servers.dserver import SPACE_CHECK_INTERVAL_NS
from colony.runtime.store.store import StoreFullError
from tests.kit.data import DRIVE, LAMP, POSE, Cramped, DataStage, checkpoint, program, request
from tests.kit.node_stage import Caller, CallError, S, messages

KEPT = [
    data.set("New", 1),
    data.set("X", 2),
    data.set_many({"X": 2, "New": 1}),
    data.set_history("X", 5),
    data.delete("X"),
    data.delete("New"),
    data.create_semaphore("new"),
    data.wait("free"),
    data.wait("taken"),
    data.signal("free"),
    data.release("taken"),
    data.delete_semaphore("free"),
    data.watch("X"),
]


@pytest.fixture
def store() -> Cramped:
    return Cramped()


@pytest.fixture
def stage(store: Cramped) -> DataStage:
    return DataStage(store, deployment=program("run", LAMP, POSE, reads=("Lamp", "X")))


@pytest.fixture
def ada(stage: DataStage) -> Caller:
    """She has a variable and holds a semaphore; another one is free."""
    ada = stage.connect()
    for ask in (
        data.set("X", 1),
        data.create_semaphore("free"),
        data.create_semaphore("taken"),
        data.wait("taken", hold=True),
    ):
        ada.do(ask)
    return ada


def fill(stage: DataStage, store: Cramped) -> None:
    """Let the disk get full, as a change that nobody was promised finds out."""
    store.room = False
    stage.handle(checkpoint(1))
    stage.tick(1)
    stage.handle(request(1, "lamp", True))
    assert store.full == "no room"


def lit(stage: DataStage, k: int, on: bool) -> None:
    """Have the program switch the lamp in frame k."""
    stage.tick(k)
    assert [verdict.by for verdict in messages(stage.handle(request(k, "lamp", on)), Verdict)] == ["counter"]


@pytest.mark.parametrize("ask", KEPT, ids=lambda ask: ask.method)
def test_what_must_be_kept_is_refused_before_anything_is_changed(
    stage: DataStage, store: Cramped, ada: Caller, ask: CallRequest[Any]
) -> None:
    fill(stage, store)
    before = stage.fields(2, "run"), ada.do(data.semaphore("free")), ada.do(data.semaphore("taken"))
    problem = ada.problem(ask)
    assert (problem.code, problem.message.partition(":")[0]) == ("full", "DServer keeps nothing new")
    assert before == (
        stage.fields(3, "run"),
        ada.do(data.semaphore("free")),
        ada.do(data.semaphore("taken")),
    )
    assert ada.do(data.names()) == ("Lamp", "X")
    assert ada.do(data.history("X"))[0].read() == 1


def test_calls_that_look_frames_and_actuators_go_on(stage: DataStage, store: Cramped, ada: Caller) -> None:
    fill(stage, store)
    assert ada.do(data.get("X")) == 1
    ada.do(data.publish("X"))
    ada.do(data.unwatch())
    for k in range(2, 100):
        stage.now_ns += S // 20
        lit(stage, k, k % 2 == 0)
        assert stage.fields(k + 1, "run") == {"Lamp": k % 2 == 0, "X": 1}
        ada.do(data.get("X"))
    stage.handle(checkpoint(50))
    leader = stage.connect("ada/leader")
    leader.do(deploy(program("next", LAMP)))
    assert leader.do(data.get("Lamp")) is False
    assert store.commits < 20  # about one a second, and none for each frame


def test_the_program_and_its_clients_find_their_memory(stage: DataStage, store: Cramped) -> None:
    stage = DataStage(store, deployment=program("run", LAMP, DRIVE))
    fill(stage, store)
    stage.handle(checkpoint(7))
    assert stage.recalled().k == 7


def test_status_tells_and_room_is_noticed(stage: DataStage, store: Cramped, ada: Caller) -> None:
    assert ada.do(STATUS).full == ()
    fill(stage, store)
    assert ada.do(STATUS).full == ("nothing new is kept: no room",)
    store.room = True
    stage.now_ns += SPACE_CHECK_INTERVAL_NS
    ada.open()
    assert ada.do(STATUS).full == ()
    ada.do(data.set("X", 2))
    stage.kill_and_restart()
    ada.open()
    assert ada.do(data.get("X")) == 2
    assert ada.do(data.get("Lamp")) is True  # what waited was kept with it


def test_nothing_that_was_acknowledged_is_lost_by_a_server_that_dies(
    stage: DataStage, store: Cramped, ada: Caller
) -> None:
    number = ada.number + 1
    ada.do(data.set("X", 5), number)
    ada.number = number
    fill(stage, store)
    stage.kill_and_restart()
    ada.open()
    assert ada.do(data.get("X")) == 5
    assert ada.do(data.set("X", 5), number) is None  # the answer that it had, not a refusal
    assert ada.do(data.semaphore("taken")).holding == (ada.name,)


def test_a_call_that_waits_is_not_answered_where_that_cannot_be_kept(
    stage: DataStage, store: Cramped, ada: Caller
) -> None:
    bob = stage.connect("bob/1")
    assert bob.begin(data.wait("taken", hold=True)) == []
    fill(stage, store)
    with pytest.raises(StoreFullError):
        ada.close()
    assert bob.replies(stage.effects)[-1].number == 1  # of `open`
    stage.kill_and_restart()
    bob.open()
    with pytest.raises(CallError, match="keeps nothing new") as failed:
        bob.do(data.wait("taken", hold=True), 2)
    assert failed.value.code == "full"


def test_a_batch_that_cannot_be_kept_ends_the_server_before_it_answers(
    stage: DataStage, store: Cramped, ada: Caller
) -> None:
    store.room = False
    sent = len(stage.effects)
    with pytest.raises(StoreFullError):
        ada.begin(data.set("X", 2))
    assert stage.effects[sent:] == []
    stage.kill_and_restart()
    ada.open()
    assert ada.do(data.get("X")) == 1
