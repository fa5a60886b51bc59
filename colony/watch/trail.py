"""The frames of a run as they came, to explain any of them: checkpoints, and the frames between them.

A follower that begins at a checkpoint and takes the frames up to one in question knows that frame's reasons.
Segments are compressed; beyond a limit, the oldest are dropped.
"""

from __future__ import annotations

import pickle
import zlib
from collections import deque
from dataclasses import replace
from threading import Lock

from colony.analysis.moments import FollowerCheckpoint, MomentFollower
from colony.ir.frame import Outcome
from colony.ir.program import Program
from colony.runtime.frames.run_frame import RunFrame
from colony.verify.explain.answer import WhyNot, explain
from colony.verify.explain.text import lines

SEGMENT_FRAMES = 50
"""Frames between two checkpoints: what is computed again for an answer."""

MAX_BYTES = 64 * 1024 * 1024
"""Maximum size of the compressed frames, in bytes: more than an hour of a robot with a ring of sonars."""


class _Segment:
    """Frames from a checkpoint on. Mutable until it is packed."""

    def __init__(self, first: int, checkpoint: FollowerCheckpoint | None) -> None:
        self.first, self.last = first, first
        self.checkpoint = checkpoint
        self.frames: list[RunFrame] = []
        self.packed: bytes | None = None


class RunTrail:
    """The frames of a run. Mutable; one thread adds frames, others ask.

    Args:
        program: the program of the run.
        max_bytes: size beyond which the oldest frames are dropped.
    """

    def __init__(self, program: Program, *, max_bytes: int = MAX_BYTES) -> None:
        self._program, self._max_bytes = program, max_bytes
        self._segments: deque[_Segment] = deque()
        self._lock = Lock()

    def begins_segment(self) -> bool:
        """Return True if the next frame begins a segment, and so needs the checkpoint before it."""
        return bool(self._segments) and len(self._segments[-1].frames) >= SEGMENT_FRAMES

    def add(self, observed: RunFrame, before: FollowerCheckpoint | None, *, resumes: bool) -> None:
        """Add a frame.

        Args:
            observed: the frame.
            before: the checkpoint before it, if it begins a segment; None for the first frame of the run.
            resumes: True if the memory before it is not known, unless its keyframe has it.
        """
        k, keyframe = observed.tick.k, observed.keyframe if resumes else None
        kept = replace(observed, keyframe=keyframe, expected=Outcome(()), requests=())
        with self._lock:
            if before is not None or not self._segments:
                self._begin(k, before)
            segment = self._segments[-1]
            segment.frames.append(kept)
            segment.last = k

    def _begin(self, k: int, checkpoint: FollowerCheckpoint | None) -> None:
        """Begin a segment; the lock is held."""
        if self._segments:
            full = self._segments[-1]
            full.packed = zlib.compress(pickle.dumps(full.frames), 1)
            full.frames = []
        self._segments.append(_Segment(k, checkpoint))
        while sum(len(s.packed or b"") for s in self._segments) > self._max_bytes:
            self._segments.popleft()

    def explain(self, k: int, module: str) -> tuple[str, ...]:
        """Return the reason why a module commands in frame k, or why it does not, as lines."""
        with self._lock:
            segment = next((s for s in reversed(self._segments) if s.first <= k), None)
            frames, packed = ([], None) if segment is None else (list(segment.frames), segment.packed)
        if segment is None:
            return (f"frame {k} is too old to be explained here",)
        if k > segment.last:
            return (f"frame {k} has not come, or was lost",)
        if packed is not None:
            frames = pickle.loads(zlib.decompress(packed))  # our own, from this process
        follower = MomentFollower(self._program, segment.checkpoint)
        for kept in frames:
            if kept.tick.k > k:
                break
            follower.take(kept)
        moment = follower.moment
        if moment is None or moment.k != k:
            return ("the memory of the program is not known in this frame",)
        return lines(explain(moment, WhyNot(module)))
