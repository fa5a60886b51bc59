"""The lane of emergency stops through a process: a queue and a thread that nothing else uses.

The receiving thread puts messages under the right to stop into the queue, undecoded. The lane's thread
decodes them and hands over emergency stops immediately. Other messages under this right, such as the opening
of a connection, take the way of all calls.
"""

from __future__ import annotations

from collections.abc import Callable
from queue import SimpleQueue
from threading import Thread
from typing import NamedTuple

from colony.runtime.protocol import codec
from colony.runtime.protocol.calls import EMERGENCY_STOP
from colony.runtime.protocol.codec import MessageFormatError
from colony.runtime.protocol.messages import Alive, Call, Malformed
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.keys import CallKey

LONGEST = 1024
"""Messages that may wait: the bursts (`border.STOPS`) of ten users at once."""

Take = Callable[[str, str, Call | Alive | Malformed, int], None]
"""A function that takes other messages than emergency stops: topic, connection, content, size in bytes."""


class _Came(NamedTuple):
    topic: str
    key: CallKey
    data: bytes
    twice: bool


class StopLane:
    """A queue with its own thread. Mutable: the waiting messages, and whether the thread runs.

    Args:
        stop: handles an emergency stop that came on a topic; called in the lane's thread.
        other: takes any other message; called in the lane's thread.
    """

    def __init__(self, stop: Callable[[str, Call], None], other: Take) -> None:
        self._stop = stop
        self._other = other
        self._queue: SimpleQueue[_Came | None] = SimpleQueue()
        self._thread = Thread(target=self._run, name="emergency stops", daemon=True)
        self._thread.start()

    def put(self, topic: str, key: CallKey, data: bytes, *, twice: bool = False) -> None:
        """Queue a message from the network without blocking; drop it if `LONGEST` messages wait.

        A message that arrives `twice` is handled only if it is an emergency stop, whose repetition is
        recognized.
        """
        if self._queue.qsize() < LONGEST:
            self._queue.put(_Came(topic, key, data, twice))

    def close(self) -> None:
        """Handle the waiting messages, and end the thread."""
        self._queue.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (came := self._queue.get()) is not None:
            message = _read(came)
            if isinstance(message, Call) and message.method == EMERGENCY_STOP:
                self._stop(came.topic, message)
            elif not came.twice:
                self._other(came.topic, came.key.connection, message, len(came.data))


def _read(came: _Came) -> Call | Alive | Malformed:
    try:
        return keys.check_call(codec.decode(came.data), came.key)
    except MessageFormatError as problem:
        return Malformed(topic=came.topic, connection=came.key.connection, reason=str(problem))
