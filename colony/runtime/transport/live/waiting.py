"""The messages that wait to be handled by a server, and their order.

Calls under the right to stop go first, then the messages of frames in order of arrival, then all other calls:
by the priority of their connection, first come first served within one (thesis section 4.3). Emergency stops
themselves do not wait here; they have a lane of their own (`stop_lane.py`).

Nothing here grows without bound. Further calls of a connection that calls faster than it is served are
refused; when all connections together hold too much, the one that holds most loses calls. Messages of frames
are dropped only when they alone would fill the memory: readers fetch missed frames again.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from colony.runtime.protocol.codec import LARGEST
from colony.runtime.protocol.messages import Alive, Call, Malformed

CALLS_EACH = 256
"""Waiting calls of one connection."""

STOPS_EACH = 16
"""Waiting calls of one connection under the right to stop."""

LINES = 2048
"""Connections with waiting messages; messages of one more connection are refused."""

OVERHEAD = 512
"""Approximate memory of a waiting message besides its payload, in bytes."""

BYTES_EACH = 8 * 1024 * 1024
BYTES_CALLS = 24 * 1024 * 1024
BYTES_FRAMES = 32 * 1024 * 1024

TOLD_MOST = 1024
"""Dropped calls whose callers are notified; the callers of any more at once are not."""


class Waiting(NamedTuple):
    """A message for the listeners of `topic`, still encoded or decoded."""

    topic: str
    message: bytes | Call | Alive | Malformed


def too_large(topic: str, connection: str | None, size: int) -> Malformed:
    """Return the replacement that a host hands its nodes for a message that is too large."""
    return Malformed(topic=topic, connection=connection, reason=f"{size} bytes; expected at most {LARGEST}")


class GivenUp(NamedTuple):
    """A dropped call: too many calls waited."""

    topic: str
    connection: str
    number: int


class _Entry(NamedTuple):
    waiting: Waiting
    connection: str
    size: int


@dataclass(frozen=False, slots=True)
class _Line:
    """The waiting messages of one connection: its calls, by their places in the order of arrival."""

    calls: dict[int, None] = field(default_factory=dict)
    size: int = 0
    stops: int = 0
    alive: bool = False


class WaitingRoom:
    """The waiting messages of a host. Mutable. Not thread-safe; see `inbox.py`."""

    def __init__(
        self,
        *,
        lines: int = LINES,
        overhead: int = OVERHEAD,
        calls_each: int = CALLS_EACH,
        bytes_each: int = BYTES_EACH,
        bytes_calls: int = BYTES_CALLS,
        bytes_frames: int = BYTES_FRAMES,
    ) -> None:
        self._most_lines = lines
        self._overhead = overhead
        self._calls_each = calls_each
        self._bytes_each = bytes_each
        self._bytes_calls = bytes_calls
        self._bytes_frames = bytes_frames
        self._stops: deque[_Entry] = deque()
        self._frames: deque[_Entry] = deque()
        self._frames_size = 0
        self._order: list[tuple[int, int]] = []
        self._calls: dict[int, _Entry] = {}
        self._calls_size = 0
        self._lines: dict[str, _Line] = {}
        self._given_up: deque[GivenUp] = deque(maxlen=TOLD_MOST)
        self._count = 0
        self.frames_lost = 0

    def frame(self, topic: str, data: bytes | Malformed) -> None:
        """Add a message that is not a call."""
        size = self._overhead + (len(data) if isinstance(data, bytes) else 0)
        self._frames.append(_Entry(Waiting(topic, data), "", size))
        self._frames_size += size
        while self._frames_size > self._bytes_frames:
            self._frames_size -= self._frames.popleft().size
            self.frames_lost += 1

    def call(self, topic: str, connection: str, message: Call | Alive | Malformed, size: int) -> None:
        """Add a connection's call, its sign of life, or a malformed message in place of either."""
        entry = _Entry(Waiting(topic, message), connection, size + self._overhead)
        line = self._lines.get(connection)
        if line is None:
            if len(self._lines) >= self._most_lines:
                self._tell(entry)
                return
            line = self._lines[connection] = _Line()
        if isinstance(message, Alive):
            if not line.alive:  # one sign of life says as much as many
                line.alive = True
                self._frames.append(entry._replace(size=0))
        elif isinstance(message, Call) and message.right == "stop":
            if line.stops < STOPS_EACH:
                line.stops += 1
                self._stops.append(entry)
            else:
                self._tell(entry)
        else:
            self._queue(entry, line)

    def crowded(self, connection: str) -> bool:
        """Return True if a connection has the maximum number of waiting calls: one more would be refused."""
        line = self._lines.get(connection)
        return line is not None and len(line.calls) >= self._calls_each

    def refuse(self, topic: str, connection: str, number: int) -> None:
        """Record a call that was not accepted, so that the caller gets a refusal."""
        self._given_up.append(GivenUp(topic, connection, number))

    def pop(self) -> Waiting | None:
        """Return the next message to handle, or None if nothing waits."""
        if self._stops:
            entry = self._stops.popleft()
            self._lines[entry.connection].stops -= 1
        elif self._frames:
            entry = self._frames.popleft()
            self._frames_size -= entry.size
            if not entry.connection:
                return entry.waiting
            self._lines[entry.connection].alive = False
        else:
            while self._order and self._order[0][1] not in self._calls:
                heapq.heappop(self._order)
            if not self._order:
                return None
            entry = self._take(heapq.heappop(self._order)[1])
        self._tidy(entry.connection)
        return entry.waiting

    @property
    def empty(self) -> bool:
        """True if nothing waits."""
        return not (self._frames or self._calls or self._stops)

    @property
    def gave_up(self) -> bool:
        """True if callers of dropped calls are still to be notified."""
        return bool(self._given_up)

    def given_up(self) -> Iterator[GivenUp]:
        """Yield the calls that were dropped since the last call of this method."""
        while self._given_up:
            yield self._given_up.popleft()

    def _queue(self, entry: _Entry, line: _Line) -> None:
        if len(line.calls) >= self._calls_each:
            self._tell(entry)
            return
        message = entry.waiting.message
        priority = message.priority if isinstance(message, Call) else 0
        self._count += 1
        self._calls[self._count] = entry
        heapq.heappush(self._order, (-priority, self._count))
        line.calls[self._count] = None
        line.size += entry.size
        self._calls_size += entry.size
        while line.size > self._bytes_each and len(line.calls) > 1:
            self._give_up(line)
        while self._calls_size > self._bytes_calls:
            self._give_up(max(self._lines.values(), key=lambda each: each.size))
        if len(self._order) > 2 * len(self._calls) + 64:
            self._order = [place for place in self._order if place[1] in self._calls]
            heapq.heapify(self._order)

    def _give_up(self, line: _Line) -> None:
        self._tell(self._take(next(iter(line.calls))))

    def _take(self, place: int) -> _Entry:
        entry = self._calls.pop(place)
        line = self._lines[entry.connection]
        del line.calls[place]
        line.size -= entry.size
        self._calls_size -= entry.size
        return entry

    def _tell(self, entry: _Entry) -> None:
        message = entry.waiting.message
        number = message.number if isinstance(message, Call) else 0
        self._given_up.append(GivenUp(entry.waiting.topic, entry.connection, number))

    def _tidy(self, connection: str) -> None:
        line = self._lines[connection]
        if not line.calls and not line.stops and not line.alive:
            del self._lines[connection]
