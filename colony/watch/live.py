"""A run that is watched while it goes on: its frames wait for the watcher; the run never does."""

from __future__ import annotations

import threading
from collections import deque

from colony.ir.program import Program
from colony.runtime.frames.run_frame import Keyframe, RunFrame
from colony.watch.following import RunFollower
from colony.watch.snapshot import ObservedFrame
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
        self._waiting: deque[ObservedFrame] = deque()
        self._changed = threading.Condition()
        self._is_closed = False
        self._thread = threading.Thread(target=self._run, name="watcher", daemon=True)
        self._thread.start()

    def take(self, log: RunFrame) -> None:
        """Let a frame wait to be shown; never blocks."""
        self.put(log)

    def put(self, frame: ObservedFrame) -> None:
        """Let a frame wait to be shown; never blocks."""
        with self._changed:
            self._waiting.append(frame)
            if len(self._waiting) > MAX_WAITING:
                self._waiting.popleft()
                self._waiting[0] = _after_gap(self._waiting[0])
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

    def _next(self) -> ObservedFrame | None:
        with self._changed:
            while not self._waiting and not self._is_closed:
                self._changed.wait()
            return self._waiting.popleft() if self._waiting else None


def _after_gap(frame: ObservedFrame) -> RunFrame:
    """Return a frame that says that frames before it are missing."""
    known = None if frame.keyframe is None else frame.keyframe.memory
    keyframe = None if known is None else Keyframe(known)
    return recorded_frame(frame, damaged=True, memory_unknown=frame.memory_unknown, keyframe=keyframe)


def recorded_frame(
    frame: ObservedFrame, *, damaged: bool, memory_unknown: bool, keyframe: Keyframe | None = None
) -> RunFrame:
    """Return a frame with other marks."""
    return RunFrame(
        tick=frame.tick,
        frame=frame.frame,
        verdicts=frame.verdicts,
        restart=frame.restart,
        memory_unknown=memory_unknown,
        keyframe=keyframe,
        damaged=damaged,
        answers=frame.answers,
    )
