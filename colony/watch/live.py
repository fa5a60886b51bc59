"""A run that is watched while it goes on: its frames wait for the watcher; the run never does."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import replace

from colony.ir.program import Program
from colony.runtime.frames.run_frame import RunFrame
from colony.watch.following import RunFollower
from colony.watch.store import SnapshotStore
from colony.watch.trail import Trail

MAX_WAITING = 200
"""Maximum number of frames that wait; beyond it the oldest are dropped, and the next counts as damaged."""

STORE_BYTES = 512 * 1024 * 1024
"""Maximum size of the snapshots of a live run, in bytes on disk: hours at 20 Hz."""


class LiveSource:
    """A sink that fills a store, in a thread of its own. Mutable.

    Args:
        program: the program of the run.
        store: the store to fill.
        trail: the trail to fill.
    """

    def __init__(self, program: Program, store: SnapshotStore, trail: Trail) -> None:
        self._follower = RunFollower(program, store, trail)
        self._store = store
        self._waiting: deque[RunFrame] = deque()
        self._changed = threading.Condition()
        self._is_closed = False
        self.heard_s = time.monotonic()
        """Time at which the last frame came, by this machine's monotonic clock."""
        self._thread = threading.Thread(target=self._run, name="watcher", daemon=True)
        self._thread.start()

    def take(self, log: RunFrame) -> None:
        """Let a frame wait to be shown; never blocks."""
        self.heard_s = time.monotonic()
        self.put(log)

    def put(self, frame: RunFrame) -> None:
        """Let a frame that came before wait to be shown; never blocks."""
        with self._changed:
            self._waiting.append(frame)
            if len(self._waiting) > MAX_WAITING:
                self._waiting.popleft()
                self._waiting[0] = replace(self._waiting[0], damaged=True)
            self._changed.notify()

    def close(self) -> None:
        """Show the frames that wait, and no more. Idempotent."""
        with self._changed:
            self._is_closed = True
            self._changed.notify()
        self._thread.join()
        self._store.is_complete = True

    def _run(self) -> None:
        try:
            while (frame := self._next()) is not None:
                self._follower.take(frame)
        except OSError as problem:
            self._store.problem = f"the frames cannot be kept: {problem.strerror}"

    def _next(self) -> RunFrame | None:
        with self._changed:
            while not self._waiting and not self._is_closed:
                self._changed.wait()
            return self._waiting.popleft() if self._waiting else None
