"""What a server keeps of a connection: who has it, and the answers to calls that may arrive again."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import NamedTuple

from colony.runtime.protocol.messages import Reply

ANSWERS_KEPT = 64
"""Replies that are kept for each connection, for calls that arrive again."""

ANSWER_BYTES_KEPT = 1024 * 1024
"""Bytes of the replies kept for each connection; the newest is kept whatever its size."""

ANSWER_OVERHEAD = 300
"""Bytes of memory that a kept reply takes besides its result."""


class Caller(NamedTuple):
    """Who calls: a connection (`user/id`), the name that it goes by, its priority, its user."""

    connection: str
    name: str
    priority: int
    user: str


@dataclass(frozen=False, slots=True, kw_only=True)
class Connection:
    """One connection. Mutable: when it was heard, its open calls, and its kept answers."""

    caller: Caller
    since_ns: int
    heard_ns: int
    calls: int = 0
    problems: int = 0
    last_problem: str | None = None
    pending: set[int] = field(default_factory=set)
    answers: OrderedDict[int, Reply] = field(default_factory=OrderedDict)
    answer_bytes: int = 0
    forgotten: int = 0

    def keep(self, reply: Reply) -> int:
        """Keep an answer, forget the oldest ones beyond the limits, and return the growth in bytes."""
        before = self.answer_bytes
        self.answers[reply.number] = reply
        self.answer_bytes += answer_size(reply)
        while len(self.answers) > ANSWERS_KEPT or (
            len(self.answers) > 1 and self.answer_bytes > ANSWER_BYTES_KEPT
        ):
            self.forget_oldest()
        return self.answer_bytes - before

    def forget_oldest(self) -> int:
        """Forget the oldest answer, and return its bytes."""
        number, old = self.answers.popitem(last=False)
        size = answer_size(old)
        self.answer_bytes -= size
        self.forgotten = max(self.forgotten, number)
        return size


def answer_size(reply: Reply) -> int:
    """Return about how many bytes of memory an answer takes."""
    text = 0 if reply.problem is None else len(reply.problem.message)
    return len(memoryview(reply.result)) + text + ANSWER_OVERHEAD
