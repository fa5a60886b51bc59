"""Answers to calls, recorded so that each call is executed exactly once, even across restarts.

A restarted server must know which of the repeated calls it has already executed. So it records its answers,
and commits each answer together with the effects of the call: the store has both or neither.

The newest `ANSWERS_PER_CONNECTION` answers of each connection are kept in a ring: number i of its answers
is in slot i mod `ANSWERS_PER_CONNECTION`. A call whose number is not above that of a dropped answer may have
been executed; it is refused, unless it is recorded as still waiting for its answer.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec

from colony.runtime.protocol.calls import RefusedError
from colony.runtime.store.store import Journal, Key

# --- bounds --------------------------------------------------------------------------------------------
#
# Limits on the state of a server, and reports of the limits that were reached.


class ResourceLimit:
    """A limit. Stateful: remembers whether a request was refused because of it.

    Args:
        what: the display name of the counted things.
        limit: the maximum count.
        in_bytes: True if the count is in bytes.
    """

    def __init__(self, what: str, limit: int, *, in_bytes: bool = False) -> None:
        self.limit = limit
        self._what = what
        self._in_bytes = in_bytes
        self._was_reached = False

    def allows(self, count: int) -> bool:
        """Return True if `count` is allowed; if not, remember that the limit was reached."""
        self._was_reached |= count > self.limit
        return count <= self.limit

    def limit_messages(self, count: int) -> tuple[str, ...]:
        """Return a message if `count` reaches the limit or a request was ever refused; else nothing."""
        if count < self.limit and not self._was_reached:
            return ()
        refused = ", and there was no room for more" if self._was_reached else ""
        return (f"{self._what}: {self._format(count)} of {self._format(self.limit)} are used{refused}",)

    def _format(self, count: int) -> str:
        if not self._in_bytes:
            return str(count)
        return f"{count / (1 << 20):.1f} MiB" if count >= 1 << 20 else f"{count / 1024:.1f} KiB"


# --- call answers --------------------------------------------------------------------------------------


ANSWERS_PER_CONNECTION = 64
"""Number of answers recorded for a connection."""

MAX_CONNECTIONS = 2000
"""Maximum number of connections with recorded answers; the least recently active are dropped."""

MAX_TOTAL_BYTES = 16 << 20
"""Byte limit of all recorded answers; each counts its result, its connection and `OVERHEAD`."""

OVERHEAD = 100
"""Bytes that an answer counts in addition to its result and its connection."""

MAX_CALL_NUMBER = (1 << 53) - 1
"""Maximum number of a call."""


class _Answer(NamedTuple):
    sequence: int
    number: int
    highest_dropped: int  # the highest number whose answer had been dropped when this one was recorded
    result: bytes


@dataclass(frozen=False, slots=True, kw_only=True)
class _Ring:
    sequence: int = 0
    highest_dropped: int = 0
    answers: dict[int, _Answer] = field(default_factory=dict)  # by number, in the order of recording
    pending: set[int] = field(default_factory=set)


class CallAnswers:
    """The recorded answers. Mutable; changes are written to the journal."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._rings: OrderedDict[str, _Ring] = OrderedDict()
        self._bound = ResourceLimit("answers to calls", MAX_TOTAL_BYTES, in_bytes=True)
        self._used = 0

    @property
    def limit_messages(self) -> tuple[str, ...]:
        """User-readable messages about the limits reached since the server started."""
        return self._bound.limit_messages(self._used)

    def find(self, connection: str, number: int) -> bytes | None:
        """Return the result in msgpack of a call that was executed; None if it was not.

        Raises:
            RefusedError: "forgotten" for a number so old that the call may have been executed; "arguments".
        """
        if not 0 < number <= MAX_CALL_NUMBER:
            raise RefusedError("arguments", f"DServer: call number {number}; expected 1 to {MAX_CALL_NUMBER}")
        ring = self._rings.get(connection)
        if ring is None:
            return None
        answer = ring.answers.get(number)
        if answer is not None:
            return answer.result
        if number <= ring.highest_dropped and number not in ring.pending:
            text = f"DServer: call {number} is too old to tell whether it was executed"
            raise RefusedError("forgotten", text)
        return None

    def record(self, connection: str, number: int, result: bytes) -> None:
        """Record the result of an executed call, in msgpack; it may be sent once the record is committed."""
        self._journal.mark_ack_pending()
        ring = self._ring(connection)
        answers = ring.answers
        oldest = next(iter(answers.values()), None)
        # the new answer takes the slot of the oldest one in a full ring
        if oldest is not None and oldest.sequence == ring.sequence - ANSWERS_PER_CONNECTION:
            self._used -= _cost(connection, answers.pop(oldest.number))
            ring.highest_dropped = max(ring.highest_dropped, oldest.number)
        answer = answers[number] = _Answer(ring.sequence, number, ring.highest_dropped, result)
        ring.sequence += 1
        self._used += _cost(connection, answer)
        self._journal.put(
            Key("answer", connection, answer.sequence % ANSWERS_PER_CONNECTION), _encode(answer)
        )
        while len(self._rings) > 1 and not self._bound.allows(self._used):
            self._forget(*self._rings.popitem(last=False))
        if number in ring.pending:
            self.clear_pending(connection, number)

    def mark_pending(self, connection: str, number: int) -> None:
        """Record that a call waits for its answer; at most `ANSWERS_PER_CONNECTION` calls of a connection."""
        pending = self._ring(connection).pending
        if len(pending) < ANSWERS_PER_CONNECTION:
            pending.add(number)
            self._journal.put(Key("pending", connection, number), b"")

    def clear_pending(self, connection: str, number: int) -> None:
        """Record that a call no longer waits."""
        ring = self._rings.get(connection)
        if ring is not None and number in ring.pending:
            ring.pending.discard(number)
            self._journal.drop(Key("pending", connection, number))

    def forget(self, connection: str, number: int) -> None:
        """Drop the answer of a call whose effect was undone, so that a repeated call is executed again."""
        ring = self._rings.get(connection)
        answer = None if ring is None else ring.answers.pop(number, None)
        if answer is not None:
            self._used -= _cost(connection, answer)
            self._journal.drop(Key("answer", connection, answer.sequence % ANSWERS_PER_CONNECTION))

    def load(self, entries: Mapping[Key, bytes]) -> None:
        """Load the entries of kinds "answer" and "pending" from a store."""
        recorded = [
            (key.name, _answers.decode(data)) for key, data in entries.items() if key.kind == "answer"
        ]
        for connection, answer in sorted(recorded, key=lambda entry: entry[1].sequence):
            ring = self._rings.setdefault(connection, _Ring())
            ring.answers[answer.number] = answer
            self._used += _cost(connection, answer)
            ring.sequence = answer.sequence + 1
            ring.highest_dropped = max(ring.highest_dropped, answer.highest_dropped)
        for key in entries:
            if key.kind == "pending":
                self._rings.setdefault(key.name, _Ring()).pending.add(key.slot)

    def _ring(self, connection: str) -> _Ring:
        ring = self._rings.get(connection)
        if ring is None:
            ring = self._rings[connection] = _Ring()
            if len(self._rings) > MAX_CONNECTIONS:
                self._forget(*self._rings.popitem(last=False))
        self._rings.move_to_end(connection)
        return ring

    def _forget(self, connection: str, ring: _Ring) -> None:
        for answer in ring.answers.values():
            self._used -= _cost(connection, answer)
            self._journal.drop(Key("answer", connection, answer.sequence % ANSWERS_PER_CONNECTION))
        for number in ring.pending:
            self._journal.drop(Key("pending", connection, number))


def _cost(connection: str, answer: _Answer) -> int:
    return len(answer.result) + len(connection) + OVERHEAD


_encode = msgspec.msgpack.Encoder().encode
_answers = msgspec.msgpack.Decoder(_Answer)
