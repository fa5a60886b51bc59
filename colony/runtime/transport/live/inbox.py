"""Where the receiving threads of the network put messages and the one thread of a host takes them out."""

from __future__ import annotations

from contextlib import suppress
from queue import Empty, SimpleQueue
from threading import Lock

from colony.runtime.protocol.messages import Alive, Call, Malformed
from colony.runtime.transport.live.waiting import GivenUp, Waiting, WaitingRoom

LONGEST_SLEEP_S = 3600.0
"""Whoever would sleep for longer is woken in between, for the system does not know times without end."""


class Inbox:
    """A waiting room for several threads. Mutable: what waits, and whether its taker sleeps.

    Putting never blocks for longer than another thread needs to put: a receiving thread that stood still
    would hold up all of the process's messages.
    """

    def __init__(self, room: WaitingRoom) -> None:
        self._room = room
        self._lock = Lock()
        self._calls: SimpleQueue[None] = SimpleQueue()
        self._asleep = False

    def frame(self, topic: str, data: bytes | Malformed, *, rouse: bool = True) -> None:
        """Put a message that is no call. With `rouse` false its taker sleeps on, and is still asleep for the
        next message: that one rouses it, and it takes both."""
        with self._lock:
            self._room.frame(topic, data)
            asleep = self._asleep and rouse
            self._asleep = self._asleep and not rouse
        if asleep:
            self._calls.put(None)

    def call(self, topic: str, connection: str, message: Call | Alive | Malformed, size: int) -> None:
        """Put a call of a connection, a sign of life of it, or what would have been one of these."""
        with self._lock:
            self._room.call(topic, connection, message, size)
            asleep, self._asleep = self._asleep, False
        if asleep:
            self._calls.put(None)

    def crowded(self, connection: str) -> bool:
        """Return whether as many calls of a connection wait as may wait: one more would be refused."""
        return self._room.crowded(connection)

    def refuse(self, topic: str, connection: str, number: int) -> None:
        """Note a call that did not come in, so that the caller gets a refusal."""
        with self._lock:
            self._room.refuse(topic, connection, number)
            asleep, self._asleep = self._asleep, False
        if asleep:
            self._calls.put(None)

    def pop(self) -> Waiting | None:
        """What is to be handled next, if anything waits."""
        with self._lock:
            waiting = self._room.pop()
            self._asleep = waiting is None
            return waiting

    def claim(self) -> bool:
        """For one that would handle a message without putting it here first: whether nothing waits.

        Nobody is woken then by what comes, until a `pop` gives nothing.
        """
        with self._lock:
            if not self._room.empty:
                return False
            self._asleep = False
            return True

    @property
    def gave_up(self) -> bool:
        """Whether calls were given up of which the callers are to be told."""
        return self._room.gave_up

    def given_up(self) -> tuple[GivenUp, ...]:
        """The calls that were given up since the last time."""
        with self._lock:
            return tuple(self._room.given_up())

    def sleep(self, timeout_s: float | None) -> None:
        """After `pop` gave nothing: until something comes, `rouse` is called, or the time is over."""
        if timeout_s is not None:
            timeout_s = min(timeout_s, LONGEST_SLEEP_S)
        with suppress(Empty):
            self._calls.get(timeout=timeout_s)

    def rouse(self) -> None:
        """End the sleep, or the next one. May be called in a signal handler."""
        self._calls.put(None)
