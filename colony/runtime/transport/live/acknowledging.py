"""A thread that finishes what nodes acknowledge, and sends what may have to wait until a link has room.

A node that stores its changes commits them here, and its answers leave afterwards: a slow disk holds up who
asked to store something, and no frame. A thread that handles messages must not wait for room on a link
either: it hands over what may be too large for the link's queue but must not be dropped (checkpoints,
notices, large replies). They do not hold up frame messages, which have another priority and so another
queue.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from queue import Empty, SimpleQueue
from threading import Thread
from typing import NamedTuple

from colony.runtime.protocol.messages import Checkpoint, Notice, Reply, Send, SentMessage, ServerFrame
from colony.runtime.transport.exchange import Exchange, Member

MAX_DROPPABLE_BYTES = 1024
"""Maximum size in bytes of a reply that may be dropped if a link is full; a link has room for many."""

BATCH = 64
"""Maximum number of answers that share one commit."""


class _Waiting(NamedTuple):
    member: Member
    sends: Sequence[Send]


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
        send: Callable[[Member, Sequence[Send]], None],
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

    def put(self, member: Member, sends: Sequence[Send]) -> None:
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
