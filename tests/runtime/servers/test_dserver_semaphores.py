"""DServer's semaphores: first come first served, time-outs, deaths, holds."""

from __future__ import annotations

from typing import Any

import pytest

from colony.runtime.library import data
from colony.runtime.library.ask import CallRequest
from colony.runtime.library.data import SemaphoreState
from colony.runtime.protocol.messages import Effect
from colony.runtime.servers.data_calls import RECONNECT_GRACE_NS
from tests.kit.data import DataStage
from tests.kit.node_stage import MS, Caller, CallError, S, result_of


@pytest.fixture
def ada(stage: DataStage) -> Caller:
    found = stage.connect()
    assert found.do(data.create_semaphore("$XYZ", 1))
    return found


def answered(connection: Caller, effects: list[Effect]) -> list[tuple[int, str | None]]:
    """The numbers of the calls that were answered, each with the code where it was refused."""
    return [(r.number, r.problem.code if r.problem else None) for r in connection.replies(effects)]


def state(connection: Caller, name: str = "$XYZ") -> SemaphoreState:
    return connection.do(data.semaphore(name))


def test_a_semaphore_is_made_once(ada: Caller) -> None:
    assert not ada.do(data.create_semaphore("$XYZ", 5))
    assert state(ada) == SemaphoreState(value=1, waiting=(), holding=())
    assert ada.do(data.semaphores()) == ("$XYZ",)
    assert ada.refusal(data.create_semaphore("$A", -1)) == "arguments"
    assert ada.refusal(data.create_semaphore("$A", 1 << 31)) == "arguments"
    assert ada.refusal(data.create_semaphore("")) == "arguments"


def test_wait_takes_and_signal_puts_back(ada: Caller) -> None:
    ada.do(data.wait("$XYZ"))
    assert state(ada).value == 0
    assert ada.refusal(data.wait("$XYZ", 0)) == "timeout"
    ada.do(data.signal("$XYZ"))
    ada.do(data.signal("$XYZ"))
    assert state(ada).value == 2


@pytest.mark.parametrize(
    "ask", [data.wait("no"), data.signal("no"), data.release("no"), data.semaphore("no")], ids=str
)
def test_unknown_semaphores_are_refused(ada: Caller, ask: CallRequest[Any]) -> None:
    assert ada.refusal(ask) == "unknown"


def test_a_semaphore_is_no_variable(ada: Caller) -> None:
    with pytest.raises(CallError, match="is a semaphore"):
        ada.do(data.get("$XYZ"))


def test_who_came_first_is_served_first_and_the_value_stays(stage: DataStage, ada: Caller) -> None:
    ada.do(data.wait("$XYZ"))
    others = [stage.connect(f"bob/{i}", priority=i) for i in range(3)]
    for other in others:
        assert other.replies(other.begin(data.wait("$XYZ"))) == []
    assert state(ada).waiting == ("bob/0", "bob/1", "bob/2")
    for other in others:
        effects = ada.begin(data.signal("$XYZ"))
        assert answered(other, effects) == [(2, None)]
        assert answered(ada, effects) == [(ada.number, None)]
        assert state(ada).value == 0


def test_one_connection_may_wait_several_times(ada: Caller) -> None:
    ada.do(data.wait("$XYZ"))
    ada.begin(data.wait("$XYZ"))
    ada.begin(data.wait("$XYZ"))
    first, second = ada.number - 1, ada.number
    assert answered(ada, ada.begin(data.signal("$XYZ"))) == [(ada.number, None), (first, None)]
    assert answered(ada, ada.begin(data.signal("$XYZ"))) == [(ada.number, None), (second, None)]


def test_whoever_waits_longer_than_it_would_is_refused(stage: DataStage, ada: Caller) -> None:
    ada.do(data.wait("$XYZ"))
    ada.begin(data.wait("$XYZ", 0.5))
    ada.begin(data.wait("$XYZ", 0.2))
    ada.begin(data.wait("$XYZ"))
    effects = stage.pass_time(199 * MS, alive=(ada,))
    assert answered(ada, effects) == []
    assert answered(ada, stage.pass_time(MS, alive=(ada,))) == [(5, "timeout")]
    assert answered(ada, stage.pass_time(300 * MS, alive=(ada,))) == [(4, "timeout")]
    assert answered(ada, stage.pass_time(5 * S, alive=(ada,))) == []
    assert answered(ada, ada.begin(data.signal("$XYZ"))) == [(ada.number, None), (6, None)]


@pytest.mark.parametrize("timeout_s", [None, float("inf"), 1e9])
def test_for_ever(stage: DataStage, ada: Caller, timeout_s: float | None) -> None:
    ada.do(data.wait("$XYZ"))
    assert ada.replies(ada.begin(data.wait("$XYZ", timeout_s))) == []
    assert len(state(ada).waiting) == 1


def test_a_dead_client_loses_its_place_within_a_second(stage: DataStage, ada: Caller) -> None:
    bob, eve = stage.connect("bob/1"), stage.connect("eve/1")
    ada.do(data.wait("$XYZ"))
    bob.begin(data.wait("$XYZ"))
    eve.begin(data.wait("$XYZ"))
    stage.pass_time(S, alive=(ada, eve))
    assert state(ada).waiting == ("eve/1",)
    assert answered(eve, ada.begin(data.signal("$XYZ"))) == [(2, None)]


def test_what_a_dead_client_took_without_holding_it_stays_taken(stage: DataStage, ada: Caller) -> None:
    bob = stage.connect("bob/1")
    bob.do(data.wait("$XYZ"))
    stage.pass_time(S, alive=(ada,))
    assert state(ada) == SemaphoreState(value=0, waiting=(), holding=())


def test_what_a_dead_client_held_goes_to_the_next_within_a_second(stage: DataStage, ada: Caller) -> None:
    bob, eve = stage.connect("bob/1"), stage.connect("eve/1")
    bob.do(data.wait("$XYZ", hold=True))
    eve.begin(data.wait("$XYZ", hold=True))
    assert state(ada) == SemaphoreState(value=0, waiting=("eve/1",), holding=("bob/1",))
    effects = stage.pass_time(S, alive=(ada, eve))
    assert answered(eve, effects) == [(2, None)]
    assert state(ada) == SemaphoreState(value=0, waiting=(), holding=("eve/1",))
    eve.close()
    assert state(ada) == SemaphoreState(value=1, waiting=(), holding=())


def test_what_was_released_is_not_given_back_again(stage: DataStage, ada: Caller) -> None:
    bob = stage.connect("bob/1")
    for give_back in (data.release, data.signal):
        bob.do(data.wait("$XYZ", hold=True))
        bob.do(give_back("$XYZ"))
    bob.close()
    assert state(ada) == SemaphoreState(value=1, waiting=(), holding=())
    assert ada.refusal(data.release("$XYZ")) == "not held"


def test_the_signal_of_another_does_not_end_a_hold(stage: DataStage, ada: Caller) -> None:
    bob = stage.connect("bob/1")
    bob.do(data.wait("$XYZ", hold=True))
    ada.do(data.signal("$XYZ"))
    assert state(ada) == SemaphoreState(value=1, waiting=(), holding=("bob/1",))


def test_a_client_that_was_gone_for_too_long_is_told_that_it_holds_no_more(
    stage: DataStage, ada: Caller
) -> None:
    bob = stage.connect("bob/1")
    bob.do(data.wait("$XYZ", hold=True))
    stage.pass_time(S, alive=(ada,))
    bob.open()
    assert bob.refusal(data.release("$XYZ")) == "not held"
    assert state(ada).value == 1


def test_a_wait_that_was_taken_back_is_done_again_when_it_is_called_again(
    stage: DataStage, ada: Caller
) -> None:
    bob = stage.connect("bob/1")
    bob.do(data.wait("$XYZ", hold=True))
    number = bob.number
    stage.pass_time(S, alive=(ada,))
    bob.open()
    bob.do(data.wait("$XYZ", hold=True), number)
    assert state(ada) == SemaphoreState(value=0, waiting=(), holding=("bob/1",))


def test_deleting_refuses_who_waits_and_forgets_who_holds(stage: DataStage, ada: Caller) -> None:
    bob = stage.connect("bob/1")
    ada.do(data.wait("$XYZ", hold=True))
    bob.begin(data.wait("$XYZ"))
    effects = ada.begin(data.delete_semaphore("$XYZ"))
    assert result_of(data.delete_semaphore(""), ada.reply(effects))
    assert answered(bob, effects) == [(2, "deleted")]
    assert not ada.do(data.delete_semaphore("$XYZ"))
    ada.do(data.create_semaphore("$XYZ", 3))
    ada.close()
    assert state(bob) == SemaphoreState(value=3, waiting=(), holding=())


# --- restarts ------------------------------------------------------------------------------------


def test_values_survive_and_who_waited_calls_again(stage: DataStage, ada: Caller) -> None:
    bob = stage.connect("bob/1")
    ada.do(data.wait("$XYZ"))
    bob.begin(data.wait("$XYZ"))
    number = bob.number
    stage.kill_and_restart()
    ada.open()
    bob.open()
    assert state(ada) == SemaphoreState(value=0, waiting=(), holding=())
    assert bob.replies(bob.begin(data.wait("$XYZ"), number)) == []
    assert answered(bob, ada.begin(data.signal("$XYZ"))) == [(number, None)]


def test_who_was_granted_in_the_last_moment_is_told_so_again(stage: DataStage, ada: Caller) -> None:
    bob = stage.connect("bob/1")
    ada.do(data.wait("$XYZ"))
    bob.begin(data.wait("$XYZ"))
    number = bob.number
    ada.begin(data.signal("$XYZ"))
    stage.kill_and_restart()
    bob.open()
    bob.do(data.wait("$XYZ"), number)
    assert state(bob) == SemaphoreState(value=0, waiting=(), holding=())


def test_a_holder_has_time_to_come_back(stage: DataStage, ada: Caller) -> None:
    bob = stage.connect("bob/1")
    bob.do(data.wait("$XYZ", hold=True))
    stage.kill_and_restart()
    ada.open()
    stage.pass_time(RECONNECT_GRACE_NS // 2, alive=(ada,))
    bob.open()
    stage.pass_time(RECONNECT_GRACE_NS, alive=(ada, bob))
    assert state(ada).holding == ("bob/1",)
    bob.do(data.release("$XYZ"))
    assert state(ada) == SemaphoreState(value=1, waiting=(), holding=())


def test_a_holder_that_does_not_come_back_holds_no_more(stage: DataStage, ada: Caller) -> None:
    bob = stage.connect("bob/1")
    bob.do(data.wait("$XYZ", hold=True))
    stage.kill_and_restart()
    ada.open()
    ada.begin(data.wait("$XYZ"))
    number = ada.number
    assert answered(ada, stage.pass_time(RECONNECT_GRACE_NS, alive=(ada,))) == [(number, None)]
    assert state(ada) == SemaphoreState(value=0, waiting=(), holding=())
    stage.kill_and_restart()
    ada.open()
    assert state(ada).holding == ()
