"""Following a run: each frame becomes a snapshot in a store, and a part of the trail that explains it."""

from __future__ import annotations

from colony.analysis.moments import MomentFollower
from colony.ir.program import Program
from colony.runtime.frames.run_frame import RunFrame
from colony.watch.snapshot import Snapshot, SnapshotMaker
from colony.watch.store import SnapshotStore
from colony.watch.trail import Trail


class RunFollower:
    """Follows a run in the reference interpreter. Stateful; takes every frame, in order.

    Args:
        program: the program.
        store: the store of snapshots to fill.
        trail: the trail to fill.
    """

    def __init__(self, program: Program, store: SnapshotStore, trail: Trail) -> None:
        self._store, self._trail = store, trail
        self._follower = MomentFollower(program)
        self._maker = SnapshotMaker(program)

    def take(self, observed: RunFrame) -> Snapshot:
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
