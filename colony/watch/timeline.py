"""Views of a whole run for a page: the timeline, the path, and the last seconds of values over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import msgspec

from colony.watch.store import SnapshotStore

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
class Timeline:
    """A run in pieces of equal numbers of frames.

    Attributes:
        first: time of the first frame in seconds.
        last: time of the last frame.
        times: time at which each piece begins.
        winners: the module that commanded longest in each piece, -1 for none.
        marks: what begins in each piece, as a sum of `Mark`s.
        is_complete: True if nothing more comes.
    """

    first: float
    last: float
    times: tuple[float, ...]
    winners: tuple[int, ...]
    marks: tuple[int, ...]
    is_complete: bool


def timeline_of(store: SnapshotStore) -> Timeline:
    """Return the timeline of the frames in a store."""
    span = store.span
    rows = store.columns(max(span.first, span.end - MAX_COUNTED), span.end)
    size = max(1, math.ceil(len(rows) / MAX_BUCKETS))
    pieces = [rows[i : i + size] for i in range(0, len(rows), size)]
    return Timeline(
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
