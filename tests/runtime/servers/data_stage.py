"""A DServer to call, without any transport: a batch is handled, it settles, and only then effects leave."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeVar

import msgspec
import pytest

from colony.ir.servers import DSERVER
from colony.runtime.library.ask import Ask
from colony.runtime.library.data import Change
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import (
    Alive,
    Call,
    Effect,
    Message,
    Notice,
    Problem,
    Reply,
    Send,
    ServerFrame,
    Tick,
    Wake,
    WakeAt,
)
from colony.runtime.servers.dserver import DServer
from colony.runtime.store.store import Key, MemoryStore, Store, StoreFullError
from tests.runtime.calling import CLOSE, call_of, opening

T = TypeVar("T")
MS = 1_000_000
S = 1000 * MS


class StageError(Exception):
    """A call that was refused."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.message)
        self.code = problem.code


class Cramped(MemoryStore):
    """A store in memory that has room, or has not. Mutable: whether it has."""

    def __init__(self) -> None:
        super().__init__()
        self.room = True
        self.commits = 0

    def check_space(self) -> None:
        self.full = None if self.room else "no room"

    def commit(self, changes: Mapping[Key, bytes | None]) -> None:
        self.commits += 1
        if not self.room:
            self.full = "no room"
            raise StoreFullError(self.full)
        super().commit(changes)


class DataStage:
    """One DServer, that can be killed and started again. `now` is the present."""

    def __init__(self, store: Store | None = None, **options: Any) -> None:
        self.store: Store = MemoryStore() if store is None else store
        self.now = S
        self.sent: list[Effect] = []
        self.options = options
        self.start()

    def start(self) -> None:
        options: dict[str, Any] = {"frames_kept": 40} | self.options
        self.server = DServer(store=self.store, **options)
        self._leave(list(self.server.start(self.now)))

    def kill_and_restart(self) -> None:
        """As by SIGKILL: what was not committed is gone."""
        self.start()

    def handle(self, *messages: Message) -> list[Effect]:
        """A batch of messages; gives the effects that left."""
        effects = [effect for message in messages for effect in self.server.handle(message, self.now)]
        self.server.settle()
        return self._leave(effects)

    def pass_time(self, ns: int, alive: Sequence[Connection] = ()) -> list[Effect]:
        """Let time go by, with those connections giving signs of life, and wakes as the server asked."""
        end, effects = self.now + ns, []
        while True:
            wakes = sorted({e.t_ns for e in self.sent if isinstance(e, WakeAt) and e.t_ns > self.now})
            due = min([end, self.now + 100 * MS, *wakes[:1]])
            self.now = due
            effects += self.handle(*(Alive(connection=c.name) for c in alive))
            effects += self.handle(Wake())
            if due == end:
                return effects

    def connect(self, name: str = "ada/1", priority: int = 0) -> Connection:
        connection = Connection(self, name, priority)
        connection.open()
        return connection

    def frame(self, k: int, run: str = "") -> ServerFrame:
        """The frame of tick `k`, which is now."""
        (frame,) = (
            effect.message
            for effect in self.handle(Tick(k=k, t_ns=self.now, run=run))
            if isinstance(effect, Send) and isinstance(effect.message, ServerFrame)
        )
        return frame

    def fields(self, k: int, run: str = "") -> dict[str, Any]:
        return {name: s.value for name, s in self.frame(k, run).fields.items() if s is not None}

    def _leave(self, effects: list[Effect]) -> list[Effect]:
        self.sent += effects
        return effects


class Connection:
    """Somebody who calls. `number` is that of its last call."""

    def __init__(self, stage: DataStage, name: str, priority: int) -> None:
        self.stage, self.name, self.priority = stage, name, priority
        self.number = 0

    def call(self, ask: Ask[Any], number: int | None = None) -> Call:
        """The message of a call; the next one, unless it is given a number."""
        if number is None:
            self.number += 1
            number = self.number
        return call_of(ask, self.name, number, self.priority)

    def open(self) -> list[Effect]:
        effects = self.stage.handle(self.call(opening(self.name)))
        assert self.reply(effects).problem is None
        return effects

    def close(self) -> None:
        self.stage.handle(self.call(CLOSE))

    def do(self, ask: Ask[T], number: int | None = None) -> T:
        """The result of a call that is answered at once."""
        return self.result(ask, self.stage.handle(self.call(ask, number)))

    def refusal(self, ask: Ask[Any]) -> str:
        """The code with which a call is refused at once."""
        with pytest.raises(StageError) as failed:
            self.do(ask)
        return failed.value.code

    def begin(self, ask: Ask[Any], number: int | None = None) -> list[Effect]:
        """Make a call that may not be answered at once."""
        return self.stage.handle(self.call(ask, number))

    def replies(self, effects: Iterable[Effect]) -> list[Reply]:
        return [e.message for e in self._mine(effects) if isinstance(e.message, Reply)]

    def reply(self, effects: Iterable[Effect]) -> Reply:
        (reply,) = self.replies(effects)
        return reply

    def result(self, ask: Ask[T], effects: Iterable[Effect]) -> T:
        reply = self.reply(effects)
        if reply.problem is not None:
            raise StageError(reply.problem)
        found: T = msgspec.msgpack.decode(reply.result, type=ask.reply)
        return found

    def changes(self, effects: Iterable[Effect]) -> list[tuple[str, Any]]:
        """What it was told by notices: names and values, `...` for a variable that was deleted."""
        notices = [e.message for e in self._mine(effects) if isinstance(e.message, Notice)]
        found = []
        for notice in notices:
            change = msgspec.msgpack.decode(notice.body, type=Change)
            assert change.name == notice.subject
            found.append((change.name, ... if change.present is None else change.present.read()))
        return found

    def _mine(self, effects: Iterable[Effect]) -> list[Send]:
        topic = topics.replies(DSERVER.name, self.name)
        return [e for e in effects if isinstance(e, Send) and e.topic == topic]
