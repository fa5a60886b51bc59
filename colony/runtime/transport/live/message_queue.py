"""The messages that wait to be handled by a server, and their order.

Calls made with the `stop` right go first, then frame messages in order of arrival, then all other calls, by
the priority of their connections, then in order of arrival (thesis section 4.3). Emergency stops do not
wait here; they have their own lane (`stop_lane.py`).

The queue is bounded. When a connection calls faster than it is served, its excess calls are refused. When the
calls of all connections exceed the byte limit, the oldest calls of the connection with the most bytes are
dropped. Frame messages are dropped only when they alone exceed their limit; readers fetch missed frames
again.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES
from colony.runtime.protocol.messages import Alive, Call, Malformed

MAX_CALLS_PER_CONNECTION = 256
"""Maximum number of queued calls of one connection."""

MAX_STOPS_PER_CONNECTION = 16
"""Maximum number of queued calls of one connection with the `stop` right."""

MAX_CONNECTIONS = 2048
"""Maximum number of connections with queued messages; messages of further connections are refused."""

MESSAGE_OVERHEAD_BYTES = 512
"""Approximate memory of a queued message in addition to its payload, in bytes."""

MAX_BYTES_PER_CONNECTION = 8 * 1024 * 1024
MAX_CALL_BYTES = 24 * 1024 * 1024
MAX_FRAME_BYTES = 32 * 1024 * 1024

MAX_NOTIFICATIONS = 1024
"""Maximum number of dropped calls whose callers have not been notified yet."""


class QueuedMessage(NamedTuple):
    """A message for the listeners of `topic`, encoded or decoded."""

    topic: str
    message: bytes | Call | Alive | Malformed


def size_violation(topic: str, connection: str | None, size: int) -> Malformed:
    """Return the message that a host hands to its nodes instead of one that is too large."""
    return Malformed(
        topic=topic, connection=connection, reason=f"{size} bytes; expected at most {MAX_MESSAGE_BYTES}"
    )


class DroppedCall(NamedTuple):
    """A call that was dropped because too many calls were queued."""

    topic: str
    connection: str
    number: int


class _Entry(NamedTuple):
    queued: QueuedMessage
    connection: str
    size: int


@dataclass(frozen=False, slots=True)
class _ConnectionQueue:
    """The queued messages of one connection; `calls` are sequence numbers in order of arrival."""

    calls: dict[int, None] = field(default_factory=dict)
    size: int = 0
    stops: int = 0
    alive: bool = False


class MessageQueue:
    """The queued messages of a host. Mutable. Not thread-safe; see `inbox.py`."""

    def __init__(
        self,
        *,
        max_connections: int = MAX_CONNECTIONS,
        overhead: int = MESSAGE_OVERHEAD_BYTES,
        max_calls_per_connection: int = MAX_CALLS_PER_CONNECTION,
        max_bytes_per_connection: int = MAX_BYTES_PER_CONNECTION,
        max_call_bytes: int = MAX_CALL_BYTES,
        max_frame_bytes: int = MAX_FRAME_BYTES,
    ) -> None:
        self._max_connections = max_connections
        self._overhead = overhead
        self._max_calls_per_connection = max_calls_per_connection
        self._max_bytes_per_connection = max_bytes_per_connection
        self._max_call_bytes = max_call_bytes
        self._max_frame_bytes = max_frame_bytes
        self._stops: deque[_Entry] = deque()
        self._frames: deque[_Entry] = deque()
        self._frames_size = 0
        self._order: list[tuple[int, int]] = []
        self._calls: dict[int, _Entry] = {}
        self._calls_size = 0
        self._connections: dict[str, _ConnectionQueue] = {}
        self._dropped_calls: deque[DroppedCall] = deque(maxlen=MAX_NOTIFICATIONS)
        self._count = 0
        self.frames_lost = 0

    def add_frame_message(self, topic: str, data: bytes | Malformed) -> None:
        """Add a message that is not a call."""
        size = self._overhead + (len(data) if isinstance(data, bytes) else 0)
        self._frames.append(_Entry(QueuedMessage(topic, data), "", size))
        self._frames_size += size
        while self._frames_size > self._max_frame_bytes:
            self._frames_size -= self._frames.popleft().size
            self.frames_lost += 1

    def add_call(self, topic: str, connection: str, message: Call | Alive | Malformed, size: int) -> None:
        """Add a call, a keepalive (`Alive`), or the `Malformed` that replaces either."""
        entry = _Entry(QueuedMessage(topic, message), connection, size + self._overhead)
        connection_queue = self._connections.get(connection)
        if connection_queue is None:
            if len(self._connections) >= self._max_connections:
                self._note_dropped(entry)
                return
            connection_queue = self._connections[connection] = _ConnectionQueue()
        if isinstance(message, Alive):
            if not connection_queue.alive:  # one keepalive is as good as many
                connection_queue.alive = True
                self._frames.append(entry._replace(size=0))
        elif isinstance(message, Call) and message.right == "stop":
            if connection_queue.stops < MAX_STOPS_PER_CONNECTION:
                connection_queue.stops += 1
                self._stops.append(entry)
            else:
                self._note_dropped(entry)
        else:
            self._add_by_priority(entry, connection_queue)

    def is_full_for(self, connection: str) -> bool:
        """Return True if one more call of this connection would be refused."""
        connection_queue = self._connections.get(connection)
        return connection_queue is not None and len(connection_queue.calls) >= self._max_calls_per_connection

    def refuse(self, topic: str, connection: str, number: int) -> None:
        """Record a call that was not accepted, so that the caller gets a refusal."""
        self._dropped_calls.append(DroppedCall(topic, connection, number))

    def pop(self) -> QueuedMessage | None:
        """Return the next message to handle, or None if the queue is empty."""
        if (queued := self.pop_frame()) is not None:
            return queued
        while self._order and self._order[0][1] not in self._calls:
            heapq.heappop(self._order)
        if not self._order:
            return None
        entry = self._take(heapq.heappop(self._order)[1])
        self._remove_if_empty(entry.connection)
        return entry.queued

    def pop_frame(self) -> QueuedMessage | None:
        """Return the next message that does not wait behind frame messages, or None if there is none."""
        if self._stops:
            entry = self._stops.popleft()
            self._connections[entry.connection].stops -= 1
        elif self._frames:
            entry = self._frames.popleft()
            self._frames_size -= entry.size
            if not entry.connection:
                return entry.queued
            self._connections[entry.connection].alive = False
        else:
            return None
        self._remove_if_empty(entry.connection)
        return entry.queued

    @property
    def has_dropped_calls(self) -> bool:
        """True if callers of dropped calls are still to be notified."""
        return bool(self._dropped_calls)

    def dropped_calls(self) -> Iterator[DroppedCall]:
        """Yield the calls that were dropped since the last call of this method."""
        while self._dropped_calls:
            yield self._dropped_calls.popleft()

    def _add_by_priority(self, entry: _Entry, connection_queue: _ConnectionQueue) -> None:
        if len(connection_queue.calls) >= self._max_calls_per_connection:
            self._note_dropped(entry)
            return
        message = entry.queued.message
        priority = message.priority if isinstance(message, Call) else 0
        self._count += 1
        self._calls[self._count] = entry
        heapq.heappush(self._order, (-priority, self._count))
        connection_queue.calls[self._count] = None
        connection_queue.size += entry.size
        self._calls_size += entry.size
        while connection_queue.size > self._max_bytes_per_connection and len(connection_queue.calls) > 1:
            self._drop_oldest(connection_queue)
        while self._calls_size > self._max_call_bytes:
            self._drop_oldest(max(self._connections.values(), key=lambda queue: queue.size))
        if len(self._order) > 2 * len(self._calls) + 64:
            self._order = [entry for entry in self._order if entry[1] in self._calls]
            heapq.heapify(self._order)

    def _drop_oldest(self, connection_queue: _ConnectionQueue) -> None:
        self._note_dropped(self._take(next(iter(connection_queue.calls))))

    def _take(self, sequence: int) -> _Entry:
        entry = self._calls.pop(sequence)
        connection_queue = self._connections[entry.connection]
        del connection_queue.calls[sequence]
        connection_queue.size -= entry.size
        self._calls_size -= entry.size
        return entry

    def _note_dropped(self, entry: _Entry) -> None:
        message = entry.queued.message
        number = message.number if isinstance(message, Call) else 0
        self._dropped_calls.append(DroppedCall(entry.queued.topic, entry.connection, number))

    def _remove_if_empty(self, connection: str) -> None:
        connection_queue = self._connections[connection]
        if not connection_queue.calls and not connection_queue.stops and not connection_queue.alive:
            del self._connections[connection]
