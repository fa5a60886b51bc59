"""A thread that sends the messages that may have to wait until a link has room.

A network thread must not wait: it may be the thread that empties the link's queue, and nothing is received
while it waits. A direct host therefore sends most messages without waiting, and hands this thread the
messages that may be too large for the queue but must not be dropped: checkpoints, notices, large replies.
They do not hold up frame messages, which have another priority and so another queue.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from queue import SimpleQueue
from threading import Thread

from colony.runtime.protocol.messages import Checkpoint, Notice, Reply, Send
from colony.runtime.transport.live.outbox import Outbox

MAX_DROPPABLE_BYTES = 1024
"""Maximum size in bytes of a reply that may be dropped if a link is full; a link has room for many."""


class Sender:
    """A queue with its own thread. Mutable.

    Args:
        outbox: outbox that waits for room; used only in the sender's thread.
        time: clock in nanoseconds.
        on_failure: callback for the exception that ended the thread; called in that thread.
    """

    def __init__(
        self, outbox: Outbox, time: Callable[[], int], on_failure: Callable[[BaseException], None]
    ) -> None:
        self._outbox = outbox
        self._time = time
        self._on_failure = on_failure
        self._queue: SimpleQueue[Sequence[Send] | None] = SimpleQueue()
        self._thread = Thread(target=self._run, name="large messages", daemon=True)
        self._thread.start()

    def put(self, sends: Sequence[Send]) -> None:
        """Queue messages without blocking."""
        self._queue.put(sends)

    def close(self) -> None:
        """Send the queued messages, and end the thread."""
        self._queue.put(None)
        self._thread.join()

    def _run(self) -> None:
        try:
            while (sends := self._queue.get()) is not None:
                self._outbox.send_all(sends, self._time())
        except BaseException as failure:
            self._on_failure(failure)


def must_block(send: Send) -> bool:
    """Return True if a message may be too large for a link's queue but must not be dropped."""
    match send.message:
        case Reply(result=result):
            return len(bytes(result)) > MAX_DROPPABLE_BYTES
        case message:
            return isinstance(message, (Checkpoint, Notice))
