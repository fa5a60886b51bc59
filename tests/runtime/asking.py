"""Somebody who asks a node of a server directly, without a transport."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

import msgspec

from colony.runtime.library.ask import Ask
from colony.runtime.protocol.messages import Alive, Effect, Node, Problem, Reply, Send, Wake, WakeAt
from tests.runtime.calling import call_of, opening

T = TypeVar("T")


class TroubleError(Exception):
    """A call that failed; `code` and message as in the reply."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.message)
        self.code = problem.code


class Asker:
    """Connections to one server. Mutable: the time up to which it was woken, the wakes that are due, replies
    that came, and the calls' numbers."""

    def __init__(self, server: Node) -> None:
        self.server = server
        self.now_ns = 0
        self.wakes: list[int] = []
        self.replies: dict[tuple[str, int], Reply] = {}
        self._numbers: dict[str, int] = {}
        self._take(server.start(0))

    def open(self, name: str, *, priority: int = 0, now_ns: int = 0) -> None:
        """Open a connection that goes by a name."""
        self.send(name, opening(name), priority=priority, now_ns=now_ns)

    def send(self, name: str, ask: Ask[T], *, priority: int = 0, now_ns: int = 0) -> int:
        """Ask; gives the number of the call."""
        number = self._numbers[name] = self._numbers.get(name, 0) + 1
        self._take(self.server.handle(call_of(ask, f"user/{name}", number, priority), now_ns))
        return number

    def do(self, name: str, ask: Ask[T], *, priority: int = 0, now_ns: int = 0) -> T:
        """Ask, and read the answer, which must come at once."""
        return self.answer(name, ask, self.send(name, ask, priority=priority, now_ns=now_ns))

    def answer(self, name: str, ask: Ask[T], number: int) -> T:
        """The answer to a call."""
        reply = self.replies[f"user/{name}", number]
        if reply.problem is not None:
            raise TroubleError(reply.problem)
        result: T = msgspec.msgpack.decode(reply.result, type=ask.reply)
        return result

    def answered(self, name: str, number: int) -> bool:
        return (f"user/{name}", number) in self.replies

    def live(self, name: str, now_ns: int) -> None:
        """Give a sign of life."""
        self._take(self.server.handle(Alive(connection=f"user/{name}"), now_ns))

    def wake(self, now_ns: int) -> None:
        """Let the time come; the wakes that were asked for until then are done."""
        while (due := min(self.wakes, default=now_ns + 1)) <= now_ns:
            self.wakes.remove(due)
            self._take(self.server.handle(Wake(), due))
        self.now_ns = now_ns
        self._take(self.server.handle(Wake(), now_ns))

    def _take(self, effects: Iterable[Effect]) -> None:
        for effect in effects:
            if isinstance(effect, WakeAt):
                self.wakes.append(effect.t_ns)
            elif isinstance(effect, Send) and isinstance(effect.message, Reply):
                self.replies[effect.message.connection, effect.message.number] = effect.message
