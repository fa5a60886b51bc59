"""The queue between the receiving network threads and a host's own thread."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from threading import Lock, Thread
from typing import NamedTuple

from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES
from colony.runtime.protocol.messages import (
    Alive,
    Call,
    Checkpoint,
    Malformed,
    Notice,
    Reply,
    SendMessage,
    SentMessage,
    ServerFrame,
)
from colony.runtime.transport.exchange import Exchange, Member

# --- message queue -------------------------------------------------------------------------------------
#
# The messages that wait to be handled by a server, and their order.
#
# Calls made with the `stop` right go first, then frame messages in order of arrival, then all other calls,
# by the priority of their connections, then in order of arrival (thesis section 4.3). Emergency stops do
# not wait here; they have their own lane (`reception.py`).
#
# The queue is bounded. When a connection calls faster than it is served, its excess calls are refused. When
# the calls of all connections exceed the byte limit, the oldest calls of the connection with the most bytes
# are dropped. Frame messages are dropped only when they alone exceed their limit; readers fetch missed
# frames again.


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


# --- acknowledging -------------------------------------------------------------------------------------
#
# A thread that finishes what nodes acknowledge, and sends what may have to wait until a link has room.
#
# A node that stores its changes commits them here, and its answers leave afterwards: a slow disk holds up
# who asked to store something, and no frame. A thread that handles messages must not wait for room on a
# link either: it hands over what may be too large for the link's queue but must not be dropped
# (checkpoints, notices, large replies). They do not hold up frame messages, which have another priority and
# so another queue.


MAX_DROPPABLE_BYTES = 1024
"""Maximum size in bytes of a reply that may be dropped if a link is full; a link has room for many."""

BATCH = 64
"""Maximum number of answers that share one commit."""


class _Waiting(NamedTuple):
    member: Member
    sends: Sequence[SendMessage]


class Acknowledging:
    """A queue with its own thread. Mutable.

    Args:
        exchange: the nodes.
        send: sends messages, and may wait for room; called only in this thread.
        on_failure: callback for the exception that ended the thread; called in that thread.
    """

    def __init__(
        self,
        exchange: Exchange,
        send: Callable[[Member, Sequence[SendMessage]], None],
        on_failure: Callable[[BaseException], None],
    ) -> None:
        self._exchange = exchange
        self._send = send
        self._on_failure = on_failure
        self._queue: SimpleQueue[_Waiting | None] = SimpleQueue()
        self._queued: set[Member] = set()
        self._thread = Thread(target=self._run, name="acknowledging", daemon=True)
        self._thread.start()

    def finish(self, member: Member) -> None:
        """Let a node settle soon that has nothing to acknowledge, without blocking."""
        if member.settling is not None and member.settling.unsettled and member not in self._queued:
            self._queued.add(member)
            self._queue.put(_Waiting(member, ()))

    def put(self, member: Member, sends: Sequence[SendMessage]) -> None:
        """Queue messages of a node without blocking, to be sent after it has settled if it has to."""
        self._queue.put(_Waiting(member, sends))

    def close(self) -> None:
        """Settle and send what waits, and end the thread."""
        self._queue.put(None)
        self._thread.join()

    def _run(self) -> None:
        try:
            while (first := self._queue.get()) is not None:
                batch, ended = self._more(first)
                for member in dict.fromkeys(waiting.member for waiting in batch):
                    self._queued.discard(member)
                    if (finish := self._exchange.settle(member)) is not None:
                        finish()
                for waiting in batch:
                    if not waiting.member.removed:  # else it may not be kept: callers ask again
                        self._send(waiting.member, waiting.sends)
                if ended:
                    return
        except BaseException as failure:
            self._on_failure(failure)

    def _more(self, first: _Waiting) -> tuple[list[_Waiting], bool]:
        """Return what waits, and True if nothing will follow."""
        batch = [first]
        try:
            while len(batch) < BATCH:
                waiting = self._queue.get_nowait()
                if waiting is None:
                    return batch, True
                batch.append(waiting)
        except Empty:
            pass
        return batch, False


def must_wait(message: SentMessage, *, settles: bool) -> bool:
    """Return True if a message must not leave at once.

    With `settles`, it is from a node that has to settle: only its frames, which acknowledge nothing, leave
    at once. Of other nodes, messages wait that may be too large for a link's queue but must not be dropped.
    """
    if settles:
        return not isinstance(message, ServerFrame)
    if isinstance(message, Reply):
        return len(bytes(message.result)) > MAX_DROPPABLE_BYTES
    return isinstance(message, (Checkpoint, Notice))


# --- inbox ---------------------------------------------------------------------------------------------


MAX_SLEEP_S = 3600.0
"""Longest single sleep in seconds, because the system has no unlimited timeout."""


class Inbox:
    """A message queue that several threads may use. Mutable.

    Adding a message blocks only while another thread uses the queue: a blocked receiving thread would hold up
    all messages of the process.
    """

    def __init__(self, queue: MessageQueue) -> None:
        self._queue = queue
        self._lock = Lock()
        self._wakeups: SimpleQueue[None] = SimpleQueue()
        self._asleep = False

    def add_frame_message(self, topic: str, data: bytes | Malformed) -> None:
        """Add a message that is not a call."""
        with self._lock:
            self._queue.add_frame_message(topic, data)
            asleep, self._asleep = self._asleep, False
        if asleep:
            self._wakeups.put(None)

    def add_call(self, topic: str, connection: str, message: Call | Alive | Malformed, size: int) -> None:
        """Add a call, a keepalive (`Alive`), or the `Malformed` that replaces either."""
        with self._lock:
            self._queue.add_call(topic, connection, message, size)
            asleep, self._asleep = self._asleep, False
        if asleep:
            self._wakeups.put(None)

    def is_full_for(self, connection: str) -> bool:
        """Return True if one more call of this connection would be refused."""
        return self._queue.is_full_for(connection)

    def refuse(self, topic: str, connection: str, number: int) -> None:
        """Record a call that was not accepted, so that the caller gets a refusal."""
        with self._lock:
            self._queue.refuse(topic, connection, number)
            asleep, self._asleep = self._asleep, False
        if asleep:
            self._wakeups.put(None)

    def pop_frame(self) -> QueuedMessage | None:
        """Return the next message that is no call or has the right to stop, or None if there is none."""
        with self._lock:
            return self._queue.pop_frame()

    def pop(self) -> QueuedMessage | None:
        """Return the next message to handle, or None if the queue is empty."""
        with self._lock:
            queued = self._queue.pop()
            self._asleep = queued is None
            return queued

    @property
    def has_dropped_calls(self) -> bool:
        """True if callers of dropped calls are still to be notified."""
        return self._queue.has_dropped_calls

    def dropped_calls(self) -> tuple[DroppedCall, ...]:
        """Return the calls that were dropped since the last call of this method."""
        with self._lock:
            return tuple(self._queue.dropped_calls())

    def sleep(self, timeout_s: float | None) -> None:
        """Sleep, after `pop` returned None, until a message, a `rouse`, or the timeout."""
        if timeout_s is not None:
            timeout_s = min(timeout_s, MAX_SLEEP_S)
        with suppress(Empty):
            self._wakeups.get(timeout=timeout_s)

    def rouse(self) -> None:
        """End the current or the next sleep. May be called in a signal handler."""
        self._wakeups.put(None)
