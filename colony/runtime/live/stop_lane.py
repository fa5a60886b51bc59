"""The lane of emergency stops through a process: a queue and a thread that nothing else uses.

The thread that receives puts in what came under the right to stop, unread; the lane's thread reads it, and
hands emergency stops over at once. All else that came so (a connection that is opened under this right) goes
the way of other calls.
"""

from __future__ import annotations

from collections.abc import Callable
from queue import SimpleQueue
from threading import Thread
from typing import NamedTuple

from colony.runtime import codec
from colony.runtime.calls import EMERGENCY_STOP
from colony.runtime.codec import NotAMessage
from colony.runtime.live import keys
from colony.runtime.live.keys import CallKey
from colony.runtime.messages import Alive, Call, Malformed

LONGEST = 1024
"""Messages that may wait; more than `border.STOPS` lets in at once, so that users do not crowd each other
out."""

Take = Callable[[str, str, Call | Alive | Malformed, int], None]
"""Takes a message that is no emergency stop: its topic, connection, content and size in bytes."""


class _Came(NamedTuple):
    topic: str
    key: CallKey
    data: bytes


class StopLane:
    """Mutable: what waits, and whether the thread runs.

    Args:
        stop: handles an emergency stop, by its topic.
        other: takes what is none.
    """

    def __init__(self, stop: Callable[[str, Call], None], other: Take) -> None:
        self._stop = stop
        self._other = other
        self._queue: SimpleQueue[_Came | None] = SimpleQueue()
        self._thread = Thread(target=self._run, name="emergency stops", daemon=True)
        self._thread.start()

    def put(self, topic: str, key: CallKey, data: bytes) -> None:
        """Take a message from the network; never waits."""
        if self._queue.qsize() < LONGEST:
            self._queue.put(_Came(topic, key, data))

    def close(self) -> None:
        """End the thread, after what waits is handled."""
        self._queue.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (came := self._queue.get()) is not None:
            message = _read(came)
            if isinstance(message, Call) and message.method == EMERGENCY_STOP:
                self._stop(came.topic, message)
            else:
                self._other(came.topic, came.key.connection, message, len(came.data))


def _read(came: _Came) -> Call | Alive | Malformed:
    try:
        return keys.check_call(codec.decode(came.data), came.key)
    except NotAMessage as problem:
        return Malformed(topic=came.topic, connection=came.key.connection, reason=str(problem))
