"""A thread that passes frames on to sinks: a slow disk or a terminal that takes nothing holds no frame up."""

from __future__ import annotations

from queue import SimpleQueue
from threading import Thread

from colony.runtime.observe.observer import FrameLog, Sink

MAX_WAITING = 20_000
"""Maximum number of frames that wait: a quarter of an hour of most robots, some 100 MB."""


class Background:
    """A sink that passes frames to another one in a thread of its own. Mutable.

    What the other sink raises is raised by the next `take`, or by `close`.
    """

    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        self._queue: SimpleQueue[FrameLog | None] = SimpleQueue()
        self._failure: BaseException | None = None
        self._has_failed = False
        self._thread = Thread(target=self._run, name="sinks", daemon=True)
        self._thread.start()

    def take(self, log: FrameLog) -> None:
        """Queue a frame.

        Raises:
            TimeoutError: too many frames wait.
            Exception: as raised by the sink.
        """
        self._raise_failure()
        if self._queue.qsize() >= MAX_WAITING:
            raise TimeoutError(f"{MAX_WAITING} frames wait to be shown and recorded: nothing takes them")
        self._queue.put(log)

    def close(self) -> None:
        """Pass on what waits, and close the sink.

        Raises:
            Exception: as raised by the sink.
        """
        self._queue.put(None)
        self._thread.join()
        self._sink.close()
        self._raise_failure()

    def _run(self) -> None:
        while (log := self._queue.get()) is not None:
            if not self._has_failed:
                try:
                    self._sink.take(log)
                except BaseException as failure:
                    self._failure, self._has_failed = failure, True

    def _raise_failure(self) -> None:
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure
