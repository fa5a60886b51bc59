"""A separate queue and thread for emergency stops.

The receiving thread puts messages sent with the `stop` right into the queue, undecoded. The lane's thread
decodes them and hands over emergency stops immediately. Other messages with this right, such as those that
open a connection, join all other calls.
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

MAX_QUEUED = 1024
"""Maximum number of queued messages: the bursts (`rate_limits.STOP_RATE`) of ten users at once."""

OtherHandler = Callable[[str, str, Call | Alive | Malformed, int], None]
"""A handler of messages other than emergency stops: topic, connection, content, size in bytes."""


class _Received(NamedTuple):
    topic: str
    key: CallKey
    data: bytes
    duplicate: bool


class StopLane:
    """A queue with its own thread. Mutable.

    Args:
        on_stop: handler of an emergency stop on a topic; called in the lane's thread.
        on_other: handler of any other message; called in the lane's thread.
    """

    def __init__(self, on_stop: Callable[[str, Call], None], on_other: OtherHandler) -> None:
        self._on_stop = on_stop
        self._on_other = on_other
        self._queue: SimpleQueue[_Received | None] = SimpleQueue()
        self._thread = Thread(target=self._run, name="emergency stops", daemon=True)
        self._thread.start()

    def put(self, topic: str, key: CallKey, data: bytes, *, duplicate: bool = False) -> None:
        """Queue a message from the network without blocking; drop it if the queue is full.

        `duplicate` marks the second copy of a message that arrives over two sessions: it is handled only if
        it is an emergency stop, whose repetition is recognized.
        """
        if self._queue.qsize() < MAX_QUEUED:
            self._queue.put(_Received(topic, key, data, duplicate))

    def close(self) -> None:
        """Handle the queued messages, and end the thread."""
        self._queue.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (received := self._queue.get()) is not None:
            message = _read(received)
            if isinstance(message, Call) and message.method == EMERGENCY_STOP:
                self._on_stop(received.topic, message)
            elif not received.duplicate:
                self._on_other(received.topic, received.key.connection, message, len(received.data))


def _read(received: _Received) -> Call | Alive | Malformed:
    try:
        return keys.check_call(codec.decode(received.data), received.key)
    except MessageFormatError as problem:
        return Malformed(topic=received.topic, connection=received.key.connection, reason=str(problem))
