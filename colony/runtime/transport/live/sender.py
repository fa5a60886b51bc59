"""A thread that sends the messages that may have to wait for room on a link.

A network thread must not wait for room: it may be the thread that makes room, and nothing is received while
it waits. A direct host therefore sends most messages without waiting, and hands this thread the messages that
exceed the room of a link and must not be dropped: checkpoints, notices, large replies. Their priority differs
from that of the messages of frames, whose queues therefore stay free while this thread waits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from queue import SimpleQueue
from threading import Thread

from colony.runtime.protocol.messages import Checkpoint, Notice, Reply, Send
from colony.runtime.transport.live.outbox import Outbox

MAX_DROPPABLE_BYTES = 1024
"""Size in bytes of the largest reply that may be dropped for lack of room; a link has room for many."""


class Sender:
    """A queue with its own thread. Mutable: the waiting messages, and whether the thread runs.

    Args:
        outbox: outbox that waits for room; used only in the sender's thread.
        time: clock in nanoseconds.
        failed: callback for the exception that ended the thread; called in that thread.
    """

    def __init__(
        self, outbox: Outbox, time: Callable[[], int], failed: Callable[[BaseException], None]
    ) -> None:
        self._outbox = outbox
        self._time = time
        self._failed = failed
        self._queue: SimpleQueue[Sequence[Send] | None] = SimpleQueue()
        self._thread = Thread(target=self._run, name="large messages", daemon=True)
        self._thread.start()

    def put(self, sends: Sequence[Send]) -> None:
        """Queue messages without blocking."""
        self._queue.put(sends)

    def close(self) -> None:
        """Send the waiting messages, and end the thread."""
        self._queue.put(None)
        self._thread.join()

    def _run(self) -> None:
        try:
            while (sends := self._queue.get()) is not None:
                self._outbox.send_all(sends, self._time())
        except BaseException as failure:
            self._failed(failure)


def must_block(send: Send) -> bool:
    """Return True if a message may exceed a link's room and must not be dropped."""
    match send.message:
        case Reply(result=result):
            return len(bytes(result)) > MAX_DROPPABLE_BYTES
        case message:
            return isinstance(message, (Checkpoint, Notice))
