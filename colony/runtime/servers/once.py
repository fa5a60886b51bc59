"""Exactly-once execution of calls, though their server died before it could answer.

A server that was restarted, or lost a connection for a while, does not know which of the calls that are
repeated now it has done already. So it notes its answers, and puts each into the store in the very commit
that has the effects of the call: either both are in the store or neither.

The newest `KEPT` answers of each connection are noted, in a ring: number i of its answers is in slot i mod
`KEPT`. Calls with numbers below one whose answer was dropped may have been done, and are refused; except for
calls that are still waiting for their answer, as these are noted too.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec

from colony.runtime.protocol.calls import RefusedError
from colony.runtime.servers.bounds import Bound
from colony.runtime.store.store import Journal, Key

KEPT = 64
"""Number of answers that are noted for a connection."""

CONNECTIONS = 2000
"""Number of connections with noted answers; those silent for the longest time are dropped."""

SPACE = 16 << 20
"""Byte limit of all noted answers; each counts for its connection and `OVERHEAD` more."""

OVERHEAD = 100
"""Bytes for which an answer counts besides its result and its connection."""

HIGHEST = (1 << 53) - 1
"""The largest valid call number."""


class _Answer(NamedTuple):
    turn: int
    number: int
    floor: int  # the highest number whose answer was gone when this one was noted
    result: bytes


@dataclass(frozen=False, slots=True, kw_only=True)
class _Ring:
    turn: int = 0
    floor: int = 0
    answers: dict[int, _Answer] = field(default_factory=dict)  # by number, in the order of their turns
    pending: set[int] = field(default_factory=set)


class CallAnswers:
    """The answers to calls. Mutable: those; changes go into the journal."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._rings: OrderedDict[str, _Ring] = OrderedDict()
        self._bound = Bound("answers to calls", SPACE, in_bytes=True)
        self._used = 0

    @property
    def reached(self) -> tuple[str, ...]:
        """Sentences for users about limits that are reached, or were since the server started."""
        return self._bound.reached(self._used)

    def find(self, connection: str, number: int) -> bytes | None:
        """Return the result in msgpack of a call that was done; None if it was not.

        Raises:
            RefusedError: "forgotten" for a number so far back that it may have been done; "arguments".
        """
        if not 0 < number <= HIGHEST:
            raise RefusedError(
                "arguments", f"DServer: a call with the number {number}; expected 1 to {HIGHEST}"
            )
        ring = self._rings.get(connection)
        if ring is None:
            return None
        answer = ring.answers.get(number)
        if answer is not None:
            return answer.result
        if number <= ring.floor and number not in ring.pending:
            text = f"DServer: call {number} comes too late to tell whether it was done already"
            raise RefusedError("forgotten", text)
        return None

    def note(self, connection: str, number: int, result: bytes) -> None:
        """Note that a call was done, with its result in msgpack, which may leave once this is committed."""
        self._journal.promise()
        ring = self._ring(connection)
        answers = ring.answers
        oldest = next(iter(answers.values()), None)
        if oldest is not None and oldest.turn == ring.turn - KEPT:  # its slot is the one to be written
            self._used -= _cost(connection, answers.pop(oldest.number))
            ring.floor = max(ring.floor, oldest.number)
        answer = answers[number] = _Answer(ring.turn, number, ring.floor, result)
        ring.turn += 1
        self._used += _cost(connection, answer)
        self._journal.put(Key("answer", connection, answer.turn % KEPT), _encode(answer))
        while len(self._rings) > 1 and not self._bound.allows(self._used):
            self._forget(*self._rings.popitem(last=False))
        if number in ring.pending:
            self.settle(connection, number)

    def pend(self, connection: str, number: int) -> None:
        """Note that a call waits for its answer; at most `KEPT` of a connection are noted."""
        pending = self._ring(connection).pending
        if len(pending) < KEPT:
            pending.add(number)
            self._journal.put(Key("pending", connection, number), b"")

    def settle(self, connection: str, number: int) -> None:
        """Note that a call waits no more."""
        ring = self._rings.get(connection)
        if ring is not None and number in ring.pending:
            ring.pending.discard(number)
            self._journal.drop(Key("pending", connection, number))

    def undo(self, connection: str, number: int) -> None:
        """Drop the answer of a call whose effect was undone: a repeated call is done again."""
        ring = self._rings.get(connection)
        answer = None if ring is None else ring.answers.pop(number, None)
        if answer is not None:
            self._used -= _cost(connection, answer)
            self._journal.drop(Key("answer", connection, answer.turn % KEPT))

    def load(self, entries: Mapping[Key, bytes]) -> None:
        """Load the entries of a store of the kinds "answer" and "pending"."""
        kept = [(key.name, _answers.decode(data)) for key, data in entries.items() if key.kind == "answer"]
        for connection, answer in sorted(kept, key=lambda one: one[1].turn):
            ring = self._rings.setdefault(connection, _Ring())
            ring.answers[answer.number] = answer
            self._used += _cost(connection, answer)
            ring.turn = answer.turn + 1
            ring.floor = max(ring.floor, answer.floor)
        for key in entries:
            if key.kind == "pending":
                self._rings.setdefault(key.name, _Ring()).pending.add(key.slot)

    def _ring(self, connection: str) -> _Ring:
        ring = self._rings.get(connection)
        if ring is None:
            ring = self._rings[connection] = _Ring()
            if len(self._rings) > CONNECTIONS:
                self._forget(*self._rings.popitem(last=False))
        self._rings.move_to_end(connection)
        return ring

    def _forget(self, connection: str, ring: _Ring) -> None:
        for answer in ring.answers.values():
            self._used -= _cost(connection, answer)
            self._journal.drop(Key("answer", connection, answer.turn % KEPT))
        for number in ring.pending:
            self._journal.drop(Key("pending", connection, number))


def _cost(connection: str, answer: _Answer) -> int:
    return len(answer.result) + len(connection) + OVERHEAD


_encode = msgspec.msgpack.Encoder().encode
_answers = msgspec.msgpack.Decoder(_Answer)
