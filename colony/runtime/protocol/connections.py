"""State that a server keeps for a connection: its caller, and the answers to calls that may be repeated."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import NamedTuple

from colony.runtime.protocol.messages import Reply

ANSWERS_KEPT = 64
"""Number of replies kept for each connection, for repeated calls."""

ANSWER_BYTES_KEPT = 1024 * 1024
"""Byte limit of the replies kept for each connection; the newest is kept regardless of its size."""

ANSWER_OVERHEAD = 300
"""Bytes of memory that a kept reply takes in addition to its result."""


class Caller(NamedTuple):
    """A caller: its connection (`user/id`), and the connection's name, priority and user."""

    connection: str
    name: str
    priority: int
    user: str


@dataclass(frozen=False, slots=True, kw_only=True)
class ConnectionRecord:
    """One connection: the time of its last message, its pending calls, and its kept answers. Mutable.

    `highest_dropped` is the highest number of a call whose answer is no longer kept.
    """

    caller: Caller
    since_ns: int
    last_message_ns: int
    calls: int = 0
    problems: int = 0
    last_problem: str | None = None
    pending: set[int] = field(default_factory=set)
    answers: OrderedDict[int, Reply] = field(default_factory=OrderedDict)
    answer_bytes: int = 0
    highest_dropped: int = 0

    def keep_answer(self, reply: Reply) -> int:
        """Keep an answer, drop the oldest ones beyond the limits, and return the change in bytes."""
        before = self.answer_bytes
        self.answers[reply.number] = reply
        self.answer_bytes += answer_size(reply)
        while len(self.answers) > ANSWERS_KEPT or (
            len(self.answers) > 1 and self.answer_bytes > ANSWER_BYTES_KEPT
        ):
            self.drop_oldest_answer()
        return self.answer_bytes - before

    def drop_oldest_answer(self) -> int:
        """Drop the oldest answer, and return its size in bytes."""
        number, old = self.answers.popitem(last=False)
        size = answer_size(old)
        self.answer_bytes -= size
        self.highest_dropped = max(self.highest_dropped, number)
        return size


def answer_size(reply: Reply) -> int:
    """Return the approximate memory that an answer takes, in bytes."""
    text = 0 if reply.problem is None else len(reply.problem.message)
    return len(memoryview(reply.result)) + text + ANSWER_OVERHEAD
