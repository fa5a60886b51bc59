"""A recording that is watched: a thread reads it, from the first frame to the last."""

from __future__ import annotations

import threading

from colony.files import reason
from colony.ir.program import Program
from colony.runtime.recordings.recorded import RecordingReader
from colony.text.diagnostics import DiagnosticError, headline
from colony.watch.following import RunFollower
from colony.watch.store import SnapshotStore
from colony.watch.trail import Trail


class RecordingSource:
    """Fills a store from a recording. Mutable.

    Args:
        reader: the recording.
        program: its program.
        store: the store to fill; closing the source leaves it open.
        trail: the trail to fill.
    """

    def __init__(self, reader: RecordingReader, program: Program, store: SnapshotStore, trail: Trail) -> None:
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
