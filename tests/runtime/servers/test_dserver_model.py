"""DServer against a plain model of it, killed at any point: between two calls of a batch, before its commit,
after it. Calls that were not acknowledged come again, and so do some that were."""

from __future__ import annotations

from typing import Any

import hypothesis.strategies as st
import msgspec
from hypothesis import settings
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from colony.runtime.library import data
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import LEASE_NS
from colony.runtime.protocol.messages import Effect
from colony.runtime.servers.data_calls import RECONNECT_GRACE_NS
from tests.kit.data import DataStage
from tests.kit.node_stage import Caller, S, result_of, settle
from tests.runtime.servers.data_model import CallOf, Model, Outcome

CONNECTIONS = ("ada/1", "bob/1", "eve/1")
MOST_CALLS = 50

variables = st.sampled_from(["X", "Y"])
callers = st.sampled_from(CONNECTIONS)
values = st.one_of(st.integers(0, 99), st.text(max_size=3), st.lists(st.floats(0, 1), max_size=3))
room_for_calls = precondition(lambda self: len(self.asked) < MOST_CALLS)


class DServerMachine(RuleBasedStateMachine):
    """Three connections call; a fourth looks on."""

    @initialize()
    def begin(self) -> None:
        self.stage, self.model = DataStage(), Model()
        self.connections = {name: self.stage.connect(name) for name in CONNECTIONS}
        self.observer = self.stage.connect("observer/1")
        self.asked: dict[CallOf, CallRequest[Any]] = {}
        self.unacknowledged: list[CallOf] = []
        self.call("ada/1", data.create_semaphore("S", 1))

    # --- calls ---------------------------------------------------------------------------------------

    @room_for_calls
    @rule(caller=callers, timeout_s=st.sampled_from([0.0, 5.0, None]), hold=st.booleans())
    def wait(self, caller: str, timeout_s: float | None, hold: bool) -> None:
        self.call(caller, data.wait("S", timeout_s, hold=hold))

    @room_for_calls
    @rule(first=callers, second=callers, hold=st.booleans())
    def queue_up(self, first: str, second: str, hold: bool) -> None:
        self.call(first, data.wait("S", hold=hold))
        self.call(second, data.wait("S"))

    @room_for_calls
    @rule(caller=callers)
    def signal(self, caller: str) -> None:
        self.call(caller, data.signal("S"))

    @room_for_calls
    @rule(caller=callers)
    def release(self, caller: str) -> None:
        self.call(caller, data.release("S"))

    @room_for_calls
    @rule(caller=callers, some=st.dictionaries(variables, values, min_size=1))
    def set_many(self, caller: str, some: dict[str, Any]) -> None:
        self.call(caller, data.set_many(some))

    @room_for_calls
    @rule(caller=callers, name=variables, length=st.integers(1, 4))
    def set_history(self, caller: str, name: str, length: int) -> None:
        self.call(caller, data.set_history(name, length))

    @room_for_calls
    @rule(caller=callers, name=variables)
    def delete(self, caller: str, name: str) -> None:
        self.call(caller, data.delete(name))

    @room_for_calls
    @rule(caller=callers, value=st.integers(0, 2))
    def make_anew(self, caller: str, value: int) -> None:
        self.call(caller, data.delete_semaphore("S"))
        self.call(caller, data.create_semaphore("S", value))
        self.call(caller, data.create_semaphore("S", value))

    @rule(place=st.floats(0, 1, exclude_max=True))
    def repeat(self, place: float) -> None:
        """One of the calls so far arrives again."""
        self.make(list(self.asked)[int(place * len(self.asked))])

    def call(self, caller: str, ask: CallRequest[Any]) -> None:
        connection = self.connections[caller]
        connection.number += 1
        call = CallOf(caller, connection.number)
        self.asked[call] = ask
        self.unacknowledged.append(call)
        self.make(call)

    def make(self, call: CallOf) -> None:
        """Make a call, perhaps again: handled, but not yet committed."""
        ask, connection = self.asked[call], self.connections[call.connection]
        expected = self.model.call(call, ask, self.stage.now_ns)
        message = connection.call(ask, call.number)
        effects = list(self.stage.node.handle(message, self.stage.now_ns))
        self.stage.keep(effects)
        if expected is not None:
            self.model.answered[call] = expected
        self.compare(effects)

    def compare(self, effects: list[Effect]) -> None:
        """What was answered is what the model answers, no more and no less."""
        found = {}
        for name, connection in self.connections.items():
            for reply in connection.replies(effects):
                if reply.number == 0:
                    continue
                code = None if reply.problem is None else reply.problem.code
                result = None if code else msgspec.msgpack.decode(reply.result)
                found[CallOf(name, reply.number)] = Outcome(result, code)
        assert found == self.model.answered
        self.model.answered = {}

    # --- commits, deaths, time -----------------------------------------------------------------------

    @rule()
    def settle(self) -> None:
        settle(self.stage.node)
        self.model.commit()
        self.unacknowledged = []

    @rule(away=st.sets(callers, max_size=2), doubled=st.booleans())
    def kill(self, away: set[str], doubled: bool) -> None:
        """The server dies; who is not away comes back, and makes again what was not acknowledged."""
        self.stage.kill_and_restart()
        self.model.kill()
        there = [self.observer, *(c for name, c in self.connections.items() if name not in away)]
        for connection in there:
            self.reopen(connection)
        if away:
            self.wait_for(RECONNECT_GRACE_NS, there)
            for name in sorted(away):
                self.model.lose(name)
            self.compare(self.effects)
            self.model.commit()
            for name in away:
                self.reopen(self.connections[name])
        again = [c for c in self.asked if c in self.unacknowledged or c in self.model.state.asked]
        for call in again * (2 if doubled else 1):
            self.make(call)

    @rule(caller=callers)
    def lose(self, caller: str) -> None:
        """A client freezes for a second; then it goes on."""
        self.settle()
        frozen = self.connections[caller]
        there = [c for c in (*self.connections.values(), self.observer) if c is not frozen]
        start = self.stage.now_ns
        self.wait_for(S, there)
        self.model.pass_time(start + LEASE_NS)
        self.model.lose(caller)
        self.model.pass_time(self.stage.now_ns)
        self.compare(self.effects)
        self.model.commit()
        self.reopen(frozen)

    @rule(seconds=st.sampled_from([1, 5]))
    def pass_time(self, seconds: int) -> None:
        self.settle()
        self.wait_for(seconds * S, [*self.connections.values(), self.observer])
        self.model.pass_time(self.stage.now_ns)
        self.compare(self.effects)
        self.model.commit()

    def wait_for(self, ns: int, alive: list[Caller]) -> None:
        self.effects = self.stage.pass_time(ns, alive=alive)

    def reopen(self, connection: Caller) -> None:
        """Under the same name; its calls are numbered on."""
        connection.open()
        self.model.commit()

    # --- what there is -------------------------------------------------------------------------------

    @invariant()
    def agrees(self) -> None:
        state, model = self.model.state, self.model
        assert set(self.look(data.names())) == set(state.histories)
        assert set(self.look(data.semaphores())) == set(state.semaphores)
        for name, history in state.histories.items():
            assert [bytes(d.value) for d in self.look(data.history(name))] == history[::-1]
        for name, value in state.semaphores.items():
            found = self.look(data.semaphore(name))
            assert found.value == value
            assert list(found.waiting) == [w.call.connection for w in model.queues.get(name, [])]
            assert sorted(found.holding) == sorted(c.connection for c, n in state.holds.items() if n == name)

    def look(self, ask: CallRequest[Any]) -> Any:
        """Ask without committing."""
        message = self.observer.call(ask)
        return result_of(ask, self.observer.reply(self.stage.node.handle(message, self.stage.now_ns)))


DServerMachine.TestCase.settings = settings(settings(), stateful_step_count=40)
TestDServer = DServerMachine.TestCase
