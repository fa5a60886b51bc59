"""A thread that passes frames on to sinks: a slow disk or a terminal that takes nothing holds no frame up."""

from __future__ import annotations

from queue import SimpleQueue
from threading import Event, Thread

from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.observe.observer import Sink

MAX_WAITING = 20_000
"""Maximum number of frames that wait: a quarter of an hour of most robots, some 100 MB."""

PAUSE_S = 0.1
"""Seconds until the next frames are passed on: waking a thread takes as long as recording a frame."""

PATIENCE_S = 10.0
"""Seconds after which a sink is given up at the end of a run, if it takes no frame meanwhile."""


class Background:
    """A sink that passes frames to another one in a thread of its own. Mutable.

    What the other sink raises is raised by the next `take`, or by `close`.

    Args:
        sink: the other sink.
        dispensable: True for a sink that needs only the newest frames: others are dropped while it takes
            none, and at the end a tenth of the patience is enough.
    """

    def __init__(self, sink: Sink, *, dispensable: bool = False) -> None:
        self._sink = sink
        self._dispensable = dispensable
        self._taken = 0
        self._queue: SimpleQueue[RunFrame | None] = SimpleQueue()
        self._failure: BaseException | None = None
        self._has_failed = False
        self._closing = Event()
        self._thread = Thread(target=self._run, name="sinks", daemon=True)
        self._thread.start()

    def take(self, log: RunFrame) -> None:
        """Queue a frame.

        Raises:
            TimeoutError: too many frames wait.
            Exception: as raised by the sink.
        """
        self._raise_failure()
        if self._dispensable and not self._queue.empty():
            return
        if self._queue.qsize() >= MAX_WAITING:
            raise TimeoutError(f"{MAX_WAITING} frames wait to be shown and recorded: nothing takes them")
        self._queue.put(log)

    def close(self) -> None:
        """Pass on what waits, and close the sink.

        Raises:
            TimeoutError: the sink takes nothing any more.
            Exception: as raised by the sink.
        """
        self._queue.put(None)
        self._closing.set()
        before = -1
        while self._thread.is_alive() and before != self._taken:
            before = self._taken
            self._thread.join(PATIENCE_S / 10 if self._dispensable else PATIENCE_S)
        if self._thread.is_alive():
            if self._dispensable:
                return
            raise TimeoutError(f"{self._queue.qsize()} frames were not recorded: nothing takes them")
        self._sink.close()
        self._raise_failure()

    def _run(self) -> None:
        while (log := self._next()) is not None:
            self._taken += 1
            if not self._has_failed:
                try:
                    self._sink.take(log)
                except BaseException as failure:
                    self._failure, self._has_failed = failure, True

    def _next(self) -> RunFrame | None:
        if self._queue.empty():
            self._closing.wait(PAUSE_S)
        return self._queue.get()

    def _raise_failure(self) -> None:
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure
