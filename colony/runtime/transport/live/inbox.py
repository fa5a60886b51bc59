"""The queue between the receiving network threads and a host's own thread."""

from __future__ import annotations

from contextlib import suppress
from queue import Empty, SimpleQueue
from threading import Lock

from colony.runtime.protocol.messages import Alive, Call, Malformed
from colony.runtime.transport.live.message_queue import DroppedCall, MessageQueue, QueuedMessage

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
