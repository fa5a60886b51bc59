"""The snapshots of a run, in a temporary file without a name, with their times and marks in memory.

One thread adds snapshots; others read. A store with a limit drops its oldest snapshots, by the segment.
"""

from __future__ import annotations

import math
import os
from array import array
from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from tempfile import TemporaryFile
from threading import Lock
from typing import NamedTuple

import msgspec

from colony.watch.snapshot import FrameMark, PageFrame, mark_of

# --- store ---------------------------------------------------------------------------------------------


SEGMENT_FRAMES = 2_000
"""Frames in a segment: 100 s at 20 Hz."""


class FrameRange(NamedTuple):
    """The numbers of the frames in a store: from `first` to before `end`."""

    first: int
    end: int


class _Segment:
    """Consecutive snapshots in a file of their own. Mutable."""

    def __init__(self, first: int) -> None:
        self.first = first
        self.file = TemporaryFile(prefix="colony-watch-", buffering=0)  # noqa: SIM115  (closed by `close`)
        self.offsets = array("q", [0])
        self.times, self.xs, self.ys = array("d"), array("d"), array("d")
        self.marks = bytearray()
        self.winners = array("h")

    def __len__(self) -> int:
        return len(self.marks)

    def add(self, snapshot: PageFrame, text: bytes, mark: FrameMark, winner: int) -> None:
        offset = self.offsets[-1]
        _write(self.file.fileno(), text, offset)
        self.offsets.append(offset + len(text))
        self.times.append(snapshot.t)
        x, y, _ = snapshot.pose or (float("nan"), float("nan"), 0.0)
        self.xs.append(x)
        self.ys.append(y)
        self.winners.append(winner)
        self.marks.append(int(mark))  # last: it is the length

    def read(self, i: int) -> bytes:
        start, end = self.offsets[i], self.offsets[i + 1]
        return os.pread(self.file.fileno(), end - start, start)


def _write(descriptor: int, data: bytes, offset: int) -> None:
    """Write all of the data: a disk that becomes full takes a part first, and only then fails."""
    while data:
        written = os.pwrite(descriptor, data, offset)
        data, offset = data[written:], offset + written


class SnapshotStore:
    """The snapshots of a run. Mutable; may be read from other threads than the one that adds.

    Args:
        modules: names of the modules; `winner` gives an index into them.
        max_bytes: size beyond which the oldest segments are dropped; None for no limit.
    """

    def __init__(self, modules: tuple[str, ...], *, max_bytes: int | None = None) -> None:
        self._numbers = {name: i for i, name in enumerate(modules)}
        self._max_bytes = max_bytes
        self._segments: deque[_Segment] = deque([_Segment(0)])
        self._lock = Lock()
        self._last: PageFrame | None = None
        self._encode = msgspec.json.Encoder().encode
        self.is_complete = False
        """True once nothing more comes."""
        self.problem: str | None = None
        """What is wrong with the source, as a sentence; None if nothing is."""

    def add(self, snapshot: PageFrame) -> None:
        """Add a snapshot.

        Raises:
            OSError: it cannot be written.
        """
        text = self._encode(snapshot)
        mark = mark_of(self._last, snapshot)
        by = next((c.by for c in snapshot.commands if c.by is not None), None)
        with self._lock:
            if len(self._segments[-1]) >= SEGMENT_FRAMES:
                last = self._segments[-1]
                self._segments.append(_Segment(last.first + len(last)))
                self._drop()
            self._segments[-1].add(snapshot, text, mark, -1 if by is None else self._numbers.get(by, -1))
            self._last = snapshot

    def _drop(self) -> None:
        if self._max_bytes is None:
            return
        while len(self._segments) > 2 and sum(s.offsets[-1] for s in self._segments) > self._max_bytes:
            self._segments.popleft().file.close()

    @property
    def span(self) -> FrameRange:
        """The frames that are in the store."""
        with self._lock:
            last = self._segments[-1]
            return FrameRange(self._segments[0].first, last.first + len(last))

    def _at(self, i: int) -> tuple[_Segment, int]:
        """Return the segment of a frame, and its place there; the lock is held."""
        for segment in reversed(self._segments):
            if i >= segment.first:
                return segment, min(i - segment.first, len(segment) - 1)
        return self._segments[0], 0

    def read(self, i: int) -> bytes:
        """Return a snapshot as JSON; the oldest one for a frame that was dropped. The store is not empty."""
        with self._lock:
            segment, place = self._at(i)
            return segment.read(place)

    def time(self, i: int) -> float:
        """Return the time of a frame in seconds."""
        with self._lock:
            segment, place = self._at(i)
            return segment.times[place]

    def index_at(self, t: float) -> int:
        """Return the frame that was current at a time: the last one that is not later, or the first."""
        with self._lock:
            for segment in reversed(self._segments):
                if segment.times and segment.times[0] <= t:
                    return segment.first + bisect_right(segment.times, t) - 1
            return self._segments[0].first

    def next_marked(self, i: int, kinds: FrameMark, *, backward: bool) -> int | None:
        """Return the nearest frame after, or before, frame `i` that has a mark of these kinds."""
        with self._lock:
            segments = reversed(self._segments) if backward else self._segments
            for segment in segments:
                places = range(len(segment))
                for place in reversed(places) if backward else places:
                    number = segment.first + place
                    is_beyond = number < i if backward else number > i
                    if is_beyond and segment.marks[place] & kinds:
                        return number
        return None

    def columns(self, first: int, end: int) -> list[tuple[float, int, int, float, float]]:
        """Return the time, marks, winner (an index or -1), and position in mm of some frames."""
        with self._lock:
            rows: list[tuple[float, int, int, float, float]] = []
            for s in self._segments:
                a, b = max(first - s.first, 0), min(end - s.first, len(s))
                if a < b:
                    rows += zip(s.times[a:b], s.marks[a:b], s.winners[a:b], s.xs[a:b], s.ys[a:b], strict=True)
            return rows

    def close(self) -> None:
        """Delete the snapshots."""
        with self._lock:
            for segment in self._segments:
                segment.file.close()


# --- timeline ------------------------------------------------------------------------------------------
#
# Views of a whole run for a page: the timeline, the path, and the last seconds of values over time.


MAX_BUCKETS = 400
"""Maximum number of pieces of a timeline."""

MAX_POINTS = 1500
"""Maximum number of points of a path."""

HISTORY_S = 20.0
"""Seconds of values over time that a page shows."""

HISTORY_POINTS = 200
"""Maximum number of values over time."""

MAX_COUNTED = 100_000
"""Maximum number of the newest frames of which a timeline is made."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunTimeline:
    """A run in pieces of equal numbers of frames.

    Attributes:
        first: time of the first frame in seconds.
        last: time of the last frame.
        times: time at which each piece begins.
        winners: the module that commanded longest in each piece, -1 for none.
        marks: what begins in each piece, as a sum of `FrameMark`s.
        is_complete: True if nothing more comes.
    """

    first: float
    last: float
    times: tuple[float, ...]
    winners: tuple[int, ...]
    marks: tuple[int, ...]
    is_complete: bool


def timeline_of(store: SnapshotStore) -> RunTimeline:
    """Return the timeline of the frames in a store."""
    span = store.span
    rows = store.columns(max(span.first, span.end - MAX_COUNTED), span.end)
    size = max(1, math.ceil(len(rows) / MAX_BUCKETS))
    pieces = [rows[i : i + size] for i in range(0, len(rows), size)]
    return RunTimeline(
        first=rows[0][0] if rows else 0.0,
        last=rows[-1][0] if rows else 0.0,
        times=tuple(piece[0][0] for piece in pieces),
        winners=tuple(_most([row[2] for row in piece]) for piece in pieces),
        marks=tuple(_any([row[1] for row in piece]) for piece in pieces),
        is_complete=store.is_complete,
    )


def _most(winners: Sequence[int]) -> int:
    return max(dict.fromkeys(winners), key=winners.count)


def _any(marks: Sequence[int]) -> int:
    result = 0
    for mark in marks:
        result |= mark
    return result


def path_to(store: SnapshotStore, end: int) -> list[tuple[float, float]]:
    """Return the positions, in mm, up to before frame `end`, with at most `MAX_POINTS` points."""
    rows = store.columns(0, end)
    step = max(1, math.ceil(len(rows) / MAX_POINTS))
    points = [(round(r[3], 1), round(r[4], 1)) for r in rows[::step] if not math.isnan(r[3])]
    if rows and not math.isnan(rows[-1][3]):
        points.append((round(rows[-1][3], 1), round(rows[-1][4], 1)))
    return points


def history_to(store: SnapshotStore, end: int) -> list[msgspec.Raw]:
    """Return snapshots of the last `HISTORY_S` seconds before frame `end`, evenly spaced."""
    span = store.span
    last = min(end, span.end) - 1
    if last < span.first:
        return []
    begin = store.index_at(store.time(last) - HISTORY_S)
    step = max(1, math.ceil((last - begin) / HISTORY_POINTS))
    return [msgspec.Raw(store.read(i)) for i in range(begin, last + 1, step)]
