"""Finding a moment of a recording by its time, with an index for which the recording is followed once."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from colony.analysis.follower import DamagedSpan
from colony.analysis.index import Index, Mark, packed
from colony.analysis.moments import MomentFollower
from colony.analysis.tracks import TrackWriter
from colony.ir.program import Program
from colony.runtime.recordings.recorded import RecordingReader
from colony.text.wording import time_text
from colony.verify.explain.moment import Moment

INTERVAL_NS = 5_000_000_000
"""Least time between two marks, in the time of the run."""


def build_index(
    program: Program,
    reader: RecordingReader,
    progress: Callable[[], None] = lambda: None,
    *,
    interval_ns: int = INTERVAL_NS,
) -> Index:
    """Follow a whole recording, and return its index; `progress` is called after each frame.

    Marks are at least `interval_ns` apart.

    Raises:
        DiagnosticError: the recording is of another program, or cannot be read.
    """
    follower, tracks = MomentFollower(program), TrackWriter()
    marks: list[Mark] = []
    frames, first_ns, last_ns = 0, 0, 0
    for recorded in reader.frames(program):
        t_ns = recorded.frame.t_ns
        is_due = not marks or t_ns - marks[-1].t_ns >= interval_ns
        if recorded.place is not None and is_due and frames and not recorded.damaged:
            before = packed(follower.checkpoint)
            marks.append(Mark(t_ns=t_ns, k=recorded.tick.k, place=recorded.place, packed=before))
        tracks.take(recorded, follower.take(recorded))
        first_ns, last_ns, frames = (first_ns if frames else t_ns), t_ns, frames + 1
        progress()
    follower.end(damaged=reader.damaged)
    return Index(
        frames=frames,
        first_ns=first_ns,
        last_ns=last_ns,
        truncation=reader.truncation,
        remarks=tuple(reader.remarks),
        damaged=tuple(_text(span, first_ns) for span in follower.damaged),
        tracks=tracks.tracks,
        marks=tuple(marks),
    )


def _text(span: DamagedSpan, first_ns: int) -> str:
    start = "its beginning" if span.after_ns is None else time_text(span.after_ns - first_ns)
    end = "its end" if span.before_ns is None else time_text(span.before_ns - first_ns)
    return f"from {start} to {end}"


class Found(NamedTuple):
    """The last frame at or before a time: its number, its time, and the moment; None if it is not known."""

    k: int
    t_ns: int
    moment: Moment | None


def moment_at(program: Program, reader: RecordingReader, index: Index, t_ns: int) -> Found:
    """Return the last frame at or before a time, which must not be before the first frame.

    Raises:
        DiagnosticError: the recording cannot be read.
    """
    mark = _mark_before(index, t_ns)
    follower = MomentFollower(program, None if mark is None else mark.checkpoint)
    if mark is not None:
        reader.go_to(mark.place)
    found: Found | None = None
    for recorded in reader.frames(program):
        if recorded.frame.t_ns > t_ns:
            break
        moment = follower.take(recorded)
        found = Found(recorded.tick.k, recorded.frame.t_ns, moment)
    assert found is not None, "no frame at or before the time"
    return found


def _mark_before(index: Index, t_ns: int) -> Mark | None:
    return next((mark for mark in reversed(index.marks) if mark.t_ns <= t_ns), None)
