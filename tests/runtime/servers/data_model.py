"""What DServer should do, in the plainest words: for comparison, never for speed."""

from __future__ import annotations

from copy import deepcopy
from typing import Any, NamedTuple

from colony.runtime.library.ask import CallRequest
from colony.runtime.servers.call_answers import ANSWERS_PER_CONNECTION


class Outcome(NamedTuple):
    """A result, or the code of what was refused."""

    result: Any = None
    code: str | None = None


class CallOf(NamedTuple):
    """A call, by its connection and number."""

    connection: str
    number: int


class Waiting(NamedTuple):
    call: CallOf
    until: int | None
    hold: bool


class State:
    """All that survives a death."""

    def __init__(self) -> None:
        self.histories: dict[str, list[Any]] = {}
        self.lengths: dict[str, int] = {}
        self.semaphores: dict[str, int] = {}
        self.holds: dict[CallOf, str] = {}
        self.done: dict[CallOf, Outcome] = {}
        self.asked: dict[CallOf, None] = {}  # waits without an answer


class Model:
    """The state, what was committed of it, and what a death takes away."""

    def __init__(self) -> None:
        self.state, self.committed = State(), State()
        self.queues: dict[str, list[Waiting]] = {}
        self.said: dict[CallOf, Outcome] = {}
        self.answered: dict[CallOf, Outcome] = {}
        """What was answered late, since it was last looked at."""

    def commit(self) -> None:
        self.committed = deepcopy(self.state)

    def kill(self) -> None:
        self.state = deepcopy(self.committed)
        self.queues, self.said = {}, {}

    # --- calls ---------------------------------------------------------------------------------------

    def call(self, call: CallOf, ask: CallRequest[Any], now: int) -> Outcome | None:
        """How a call comes out; None where it waits."""
        if call in self.said:
            return self.said[call]
        if any(w.call == call for queue in self.queues.values() for w in queue):
            return None
        outcome = self.state.done.get(call)
        if outcome is None:
            outcome = self._do(call, ask, now)
            if outcome is not None and outcome.code is None:
                self._note(call, outcome)
        if outcome is not None:
            self.said[call] = outcome
            self.state.asked.pop(call, None)
        return outcome

    def _note(self, call: CallOf, outcome: Outcome) -> None:
        self.state.done[call] = outcome
        mine = [c for c in self.state.done if c.connection == call.connection]
        assert len(mine) < ANSWERS_PER_CONNECTION, "the model does not know that answers are forgotten"

    def _do(self, call: CallOf, ask: CallRequest[Any], now: int) -> Outcome | None:
        state, a = self.state, ask.arguments
        match ask.method:
            case "set_many":
                for name, value in a.read().items():  # type: ignore[attr-defined]
                    length = state.lengths.setdefault(name, 1)
                    state.histories[name] = [*state.histories.get(name, []), bytes(value)][-length:]
                return Outcome()
            case "set_history":
                state.lengths[a.name] = a.length  # type: ignore[attr-defined]
                state.histories[a.name] = state.histories.get(a.name, [])[-a.length :]  # type: ignore[attr-defined]
                return Outcome()
            case "delete":
                state.lengths.pop(a.name, None)  # type: ignore[attr-defined]
                return Outcome(state.histories.pop(a.name, None) is not None)  # type: ignore[attr-defined]
            case "create_semaphore":
                new = a.name not in state.semaphores  # type: ignore[attr-defined]
                if new:
                    state.semaphores[a.name] = a.value  # type: ignore[attr-defined]
                return Outcome(new)
            case "delete_semaphore":
                return self._delete_semaphore(a.name)  # type: ignore[attr-defined]
            case "wait":
                return self._wait(call, a, now)
            case "signal" | "release":
                return self._give(call, a.name, ask.method == "release")  # type: ignore[attr-defined]
            case other:
                raise AssertionError(other)

    def _delete_semaphore(self, name: str) -> Outcome:
        for waiting in self.queues.pop(name, []):
            self._answer(waiting.call, Outcome(code="deleted"))
        self.state.holds = {c: n for c, n in self.state.holds.items() if n != name}
        return Outcome(self.state.semaphores.pop(name, None) is not None)

    def _wait(self, call: CallOf, a: Any, now: int) -> Outcome | None:
        if a.name not in self.state.semaphores:
            return Outcome(code="unknown")
        if self.state.semaphores[a.name] > 0:
            self.state.semaphores[a.name] -= 1
            if a.hold:
                self.state.holds[call] = a.name
            return Outcome()
        if a.wait_ns == 0:
            return Outcome(code="timeout")
        until = None if a.wait_ns is None else now + a.wait_ns
        self.queues.setdefault(a.name, []).append(Waiting(call, until, a.hold))
        self.state.asked[call] = None
        return None

    def _give(self, call: CallOf, name: str, strictly: bool) -> Outcome:
        if name not in self.state.semaphores:
            return Outcome(code="unknown")
        mine = [c for c, n in self.state.holds.items() if c.connection == call.connection and n == name]
        if mine:
            del self.state.holds[mine[0]]
        elif strictly:
            return Outcome(code="not held")
        self._put_back(name)
        return Outcome()

    def _put_back(self, name: str) -> None:
        queue = self.queues.get(name, [])
        if not queue:
            self.state.semaphores[name] += 1
            return
        first = queue.pop(0)
        if first.hold:
            self.state.holds[first.call] = name
        self._note(first.call, Outcome())
        self._answer(first.call, Outcome())

    def _answer(self, call: CallOf, outcome: Outcome) -> None:
        self.answered[call] = self.said[call] = outcome
        self.state.asked.pop(call, None)

    # --- deaths and time -----------------------------------------------------------------------------

    def lose(self, connection: str) -> None:
        for queue in self.queues.values():
            queue[:] = [w for w in queue if w.call.connection != connection]
        self.said = {c: o for c, o in self.said.items() if c.connection != connection}
        for call, name in [(c, n) for c, n in self.state.holds.items() if c.connection == connection]:
            del self.state.holds[call]
            del self.state.done[call]
            self._put_back(name)

    def pass_time(self, until: int) -> None:
        for queue in self.queues.values():
            for waiting in [w for w in queue if w.until is not None and w.until <= until]:
                queue.remove(waiting)
                self._answer(waiting.call, Outcome(code="timeout"))
