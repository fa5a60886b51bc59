"""A node on a stage, without a transport: the time, the messages that it gets, and those who call it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

import msgspec

from colony.runtime.library.ask import CallRequest
from colony.runtime.library.data import Change
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import (
    Alive,
    Call,
    Effect,
    Message,
    Node,
    Notice,
    Problem,
    Reply,
    SendMessage,
    ServerFrame,
    SettlingNode,
    Wake,
    WakeAt,
)
from tests.kit.calling import CLOSE, call_of, opening

T = TypeVar("T")
MS = 1_000_000
S = 1000 * MS
FRAME_NS = 50 * MS


class CallError(Exception):
    """A call that was refused."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.message)
        self.code = problem.code


def messages(effects: Iterable[Effect], kind: type[T]) -> list[T]:
    """Return the messages of a type."""
    return [e.message for e in effects if isinstance(e, SendMessage) and isinstance(e.message, kind)]


def sent(node: Node, *batch: Message, now_ns: int = 0) -> list[Any]:
    """Hand messages to a node without a stage; gives the messages that it sends."""
    return messages([effect for message in batch for effect in node.handle(message, now_ns)], object)


def result_of(ask: CallRequest[T], reply: Reply) -> T:
    """Return the result of a call.

    Raises:
        CallError: it was refused.
    """
    if reply.problem is not None:
        raise CallError(reply.problem)
    result: T = msgspec.msgpack.decode(reply.result, type=ask.reply)
    return result


def settle(settling: SettlingNode) -> None:
    """Let a node, or its journal, finish what it must do before it acknowledges."""
    if (finish := settling.settle()) is not None:
        finish()


class NodeStage:
    """A node and the present. Mutable.

    `effects` are all that the node had so far, `wakes` those to come, `replies` the answers by connection and
    number.
    """

    def __init__(self, node: Node, now_ns: int = 0) -> None:
        self.now_ns = now_ns
        self.effects: list[Effect] = []
        self.replies: dict[tuple[str, int], Reply] = {}
        self.start(node)

    def start(self, node: Node) -> None:
        """Start a node, in the place of the one until now."""
        self.node, self.wakes = node, list[int]()
        self.keep(list(node.start(self.now_ns)))

    def handle(self, *batch: Message) -> list[Effect]:
        """Hand the node a batch of messages; gives the effects."""
        effects = [effect for message in batch for effect in self.node.handle(message, self.now_ns)]
        if isinstance(self.node, SettlingNode):
            settle(self.node)
        self.keep(effects)
        return effects

    def keep(self, effects: Sequence[Effect]) -> None:
        """Note effects."""
        self.effects += effects
        self.wakes += [effect.t_ns for effect in effects if isinstance(effect, WakeAt)]
        self.replies |= {(reply.connection, reply.number): reply for reply in messages(effects, Reply)}

    def advance(self, t_ns: int) -> None:
        """Let it be this time, unless it is later already."""
        self.now_ns = max(self.now_ns, t_ns)

    def until(self, t_ns: int, alive: Iterable[Caller] = ()) -> list[Effect]:
        """Let time pass, with the wakes that were asked for and signs of life of these callers."""
        before, alive = len(self.effects), list(alive)
        while self.now_ns < t_ns or min(self.wakes, default=t_ns + 1) <= t_ns:
            due = min([t_ns, *self.wakes, *([self.now_ns + 100 * MS] if alive else [])])
            self.advance(due)
            self.handle(*(Alive(connection=caller.name) for caller in alive))
            if due in self.wakes:
                self.wakes.remove(due)
                self.wake()
        return self.effects[before:]

    def wake(self) -> None:
        """Wake the node."""
        self.handle(Wake())

    def pass_time(self, ns: int, alive: Iterable[Caller] = ()) -> list[Effect]:
        """Let some time pass."""
        return self.until(self.now_ns + ns, alive)

    def connect(self, name: str = "ada/1", priority: int = 0) -> Caller:
        """Open a connection."""
        caller = Caller(self, name, priority)
        caller.open()
        return caller

    def server_frame(self, message: Message) -> ServerFrame:
        """The frame with which a server answers a message."""
        (frame,) = messages(self.handle(message), ServerFrame)
        return frame


class Caller:
    """A connection to the node of a stage. Mutable: `number` is that of its last call."""

    def __init__(self, stage: NodeStage, name: str, priority: int = 0) -> None:
        self.stage, self.name, self.priority = stage, name, priority
        self.number = 0

    def call(self, ask: CallRequest[Any], number: int | None = None) -> Call:
        """The message of a call; the next one, unless it is given a number."""
        if number is None:
            self.number += 1
            number = self.number
        return call_of(ask, self.name, number, self.priority)

    def begin(self, ask: CallRequest[Any], number: int | None = None) -> list[Effect]:
        """Make a call that may not be answered at once."""
        return self.stage.handle(self.call(ask, number))

    def open(self, name: str | None = None) -> list[Effect]:
        effects = self.begin(opening(name or self.name.partition("/")[0]))
        assert self.reply(effects).problem is None
        return effects

    def close(self) -> None:
        self.begin(CLOSE)

    def do(self, ask: CallRequest[T], number: int | None = None) -> T:
        """The result of a call that is answered at once."""
        return result_of(ask, self._answer(self.begin(ask, number), number or self.number))

    def problem(self, ask: CallRequest[Any]) -> Problem:
        """Why a call is refused at once."""
        problem = self._answer(self.begin(ask), self.number).problem
        assert problem is not None
        return problem

    def refusal(self, ask: CallRequest[Any]) -> str:
        """The code with which a call is refused at once."""
        return self.problem(ask).code

    def replies(self, effects: Iterable[Effect]) -> list[Reply]:
        return [r for r in messages(self._mine(effects), Reply) if r.connection == self.name]

    def reply(self, effects: Iterable[Effect]) -> Reply:
        (reply,) = self.replies(effects)
        return reply

    def _answer(self, effects: Iterable[Effect], number: int) -> Reply:
        (reply,) = (r for r in self.replies(effects) if r.number == number)
        return reply

    @property
    def last(self) -> Reply | None:
        """The answer to the last call; None while there is none."""
        return self.stage.replies.get((self.name, self.number))

    def changes(self, effects: Iterable[Effect]) -> list[tuple[str, Any]]:
        """What it was told by notices: names and values, `...` for a variable that was deleted."""
        found = []
        for notice in messages(self._mine(effects), Notice):
            change = msgspec.msgpack.decode(notice.body, type=Change)
            assert change.name == notice.subject
            found.append((change.name, ... if change.present is None else change.present.read()))
        return found

    def _mine(self, effects: Iterable[Effect]) -> list[Effect]:
        topic = topics.replies(self.stage.node.address, self.name)
        return [e for e in effects if isinstance(e, SendMessage) and e.topic == topic]
