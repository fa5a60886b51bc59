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
    """A waiting room for several threads. Mutable: the waiting messages, and whether the consumer sleeps.

    Putting a message blocks only while another thread puts one: a blocked receiving thread would hold up all
    messages of the process.
    """

    def __init__(self, room: MessageQueue) -> None:
        self._room = room
        self._lock = Lock()
        self._calls: SimpleQueue[None] = SimpleQueue()
        self._asleep = False

    def frame(self, topic: str, data: bytes | Malformed, *, rouse: bool = True) -> None:
        """Put a message that is not a call.

        If `rouse` is false, the consumer sleeps until the next message that wakes it, and then takes both.
        """
        with self._lock:
            self._room.frame(topic, data)
            asleep = self._asleep and rouse
            self._asleep = self._asleep and not rouse
        if asleep:
            self._calls.put(None)

    def call(self, topic: str, connection: str, message: Call | Alive | Malformed, size: int) -> None:
        """Put a connection's call, its sign of life, or a malformed message in place of either."""
        with self._lock:
            self._room.call(topic, connection, message, size)
            asleep, self._asleep = self._asleep, False
        if asleep:
            self._calls.put(None)

    def is_full_for(self, connection: str) -> bool:
        """Return True if a connection has the maximum number of waiting calls: one more would be refused."""
        return self._room.is_full_for(connection)

    def refuse(self, topic: str, connection: str, number: int) -> None:
        """Record a call that was not accepted, so that the caller gets a refusal."""
        with self._lock:
            self._room.refuse(topic, connection, number)
            asleep, self._asleep = self._asleep, False
        if asleep:
            self._calls.put(None)

    def pop(self) -> QueuedMessage | None:
        """Return the next message to handle, or None if nothing waits."""
        with self._lock:
            waiting = self._room.pop()
            self._asleep = waiting is None
            return waiting

    def claim(self) -> bool:
        """Return True if nothing waits, so the calling thread may handle a message without queueing it.

        From then on, arriving messages wake no thread until a `pop` returns None.
        """
        with self._lock:
            if not self._room.empty:
                return False
            self._asleep = False
            return True

    @property
    def has_dropped_calls(self) -> bool:
        """True if callers of dropped calls are still to be notified."""
        return self._room.has_dropped_calls

    def dropped_calls(self) -> tuple[DroppedCall, ...]:
        """Return the calls that were dropped since the last call of this method."""
        with self._lock:
            return tuple(self._room.dropped_calls())

    def sleep(self, timeout_s: float | None) -> None:
        """Sleep, after `pop` returned None, until a message, a `rouse`, or the timeout."""
        if timeout_s is not None:
            timeout_s = min(timeout_s, MAX_SLEEP_S)
        with suppress(Empty):
            self._calls.get(timeout=timeout_s)

    def rouse(self) -> None:
        """End the current or the next sleep. May be called in a signal handler."""
        self._calls.put(None)
