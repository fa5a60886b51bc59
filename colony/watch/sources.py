"""Where the frames that pages show come from: a recording, or a run that goes on.

Each frame becomes a snapshot in a store, and a part of the trail that explains it.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace

from colony.analysis.moments import MomentFollower
from colony.files import reason
from colony.ir.program import Program
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.observe.closing import repeating
from colony.runtime.recordings.recorded import RecordingReader
from colony.text.diagnostics import DiagnosticError, headline
from colony.watch.snapshot import PageFrame, SnapshotMaker
from colony.watch.store import SnapshotStore
from colony.watch.trail import RunTrail

MAX_WAITING = 200
"""Maximum number of frames that wait; beyond it the oldest are dropped, and the next counts as damaged."""

STORE_BYTES = 512 * 1024 * 1024
"""Maximum size of the snapshots of a live run, in bytes on disk: hours at 20 Hz."""

SILENCE_S = 2.0
"""Seconds without a frame after which a robot counts as silent."""

CHECK_INTERVAL_S = 0.5
"""Seconds between two checks for silence."""


class RunFollower:
    """Follows a run in the reference interpreter. Stateful; takes every frame, in order.

    Args:
        program: the program.
        store: the store of snapshots to fill.
        trail: the trail to fill.
    """

    def __init__(self, program: Program, store: SnapshotStore, trail: RunTrail) -> None:
        self._store, self._trail = store, trail
        self._follower = MomentFollower(program)
        self._maker = SnapshotMaker(program)

    def take(self, observed: RunFrame) -> PageFrame:
        """Take the next frame; return its snapshot.

        Raises:
            OSError: the snapshot cannot be kept.
        """
        follower = self._follower
        before = follower.checkpoint if self._trail.begins_segment() else None
        resumes = observed.damaged or follower.interpreter is None
        moment = follower.take(observed)
        outcome = None if moment is None else moment.outcome
        interpreter = None if moment is None else follower.interpreter
        snapshot = self._maker.make(observed, outcome, interpreter)
        self._trail.add(observed, before, resumes=resumes)
        self._store.add(snapshot)
        return snapshot


class RecordingSource:
    """Fills a store from a recording. Mutable.

    Args:
        reader: the recording.
        program: its program.
        store: the store to fill; closing the source leaves it open.
        trail: the trail to fill.
    """

    def __init__(
        self, reader: RecordingReader, program: Program, store: SnapshotStore, trail: RunTrail
    ) -> None:
        self._reader, self._program, self._store = reader, program, store
        self._follower = RunFollower(program, store, trail)
        self._closed = False
        self._thread = threading.Thread(target=self._read, name="recording", daemon=True)
        self._thread.start()

    def _read(self) -> None:
        store = self._store
        try:
            for recorded in self._reader.frames(self._program):
                if self._closed:
                    return
                self._follower.take(recorded)
            store.problem = self._reader.truncation or "; ".join(self._reader.remarks) or None
            if self._reader.damaged:
                store.problem = "it is damaged at its end"
            if store.problem is None and store.span.end == 0:
                store.problem = "it contains no frame"
        except DiagnosticError as failure:
            store.problem = headline(failure.diagnostics[0])
        except Exception as problem:
            store.problem = f"the frames cannot be read or kept: {reason(problem)}"
        finally:
            store.is_complete = True

    def close(self) -> None:
        """Stop reading. Idempotent."""
        self._closed = True
        self._thread.join()

    def __enter__(self) -> RecordingSource:
        """Return the source."""
        return self

    def __exit__(self, *raised: object) -> None:
        """Stop reading."""
        self.close()


class LiveSource:
    """A sink that fills a store, in a thread of its own. Mutable.

    Args:
        program: the program of the run.
        store: the store to fill.
        trail: the trail to fill.
        tap: function that also takes each frame, in the same thread.
    """

    def __init__(
        self,
        program: Program,
        store: SnapshotStore,
        trail: RunTrail,
        tap: Callable[[RunFrame], None] = lambda frame: None,
    ) -> None:
        self._follower, self._tap = RunFollower(program, store, trail), tap
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
                self._tap(frame)
        except OSError as problem:
            self._store.problem = f"the frames cannot be kept: {problem.strerror}"

    def _next(self) -> RunFrame | None:
        with self._changed:
            while not self._waiting and not self._is_closed:
                self._changed.wait()
            return self._waiting.popleft() if self._waiting else None


def noting_silence(source: LiveSource, store: SnapshotStore, text: str) -> AbstractContextManager[None]:
    """Return a context in which `text` stands in the store whenever the robot is silent."""
    said: str | None = None

    def check() -> None:
        nonlocal said
        is_silent = time.monotonic() - source.heard_s > SILENCE_S
        if is_silent and store.problem is None:
            store.problem = said = text
        elif not is_silent and said is not None and store.problem == said:
            store.problem = said = None

    return repeating("silence", check, interval_s=CHECK_INTERVAL_S)
