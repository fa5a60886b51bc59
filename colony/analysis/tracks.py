"""What changed in a recording, and when: a track for each module, sensor, actuator and client."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from colony.ir.given import MISSED
from colony.runtime.frames.run_frame import RunFrame
from colony.verify.explain.moment import Moment


class Change(NamedTuple):
    """A value that a track has from a frame on."""

    t_ns: int
    k: int
    value: str


Tracks = dict[str, list[Change]]
"""Tracks by name: `module NAME`, `sensor NAME`, `actuator NAME`, `client NAME`."""

IDLE = "idle"
OUTSIDE = "outside"
IN_TIME = "in time"
"""The value of a client's track while it answers in time."""

UNKNOWN = "unknown"
"""The value of a track while memory is not known, or its verdict was not recorded."""


class TrackWriter:
    """Collects what changes from frame to frame. Stateful."""

    def __init__(self) -> None:
        self.tracks: Tracks = {}

    def take(self, recorded: RunFrame, moment: Moment | None) -> None:
        """Take a frame."""
        t_ns, k = recorded.frame.t_ns, recorded.tick.k
        values = dict(_of_runtime(recorded))
        values |= dict(_of_moment(moment)) if moment is not None else {}
        for name in self.tracks.keys() - values.keys():
            values[name] = UNKNOWN
        for name, value in values.items():
            track = self.tracks.setdefault(name, [])
            if not track or track[-1].value != value:
                track.append(Change(t_ns, k, value))


def _of_runtime(recorded: RunFrame) -> Iterator[tuple[str, str]]:
    for actuator, verdict in recorded.verdicts.items():
        outside = verdict.outside is not None
        yield (
            f"actuator {actuator}",
            OUTSIDE if outside else IDLE if verdict.by is None else f"by {verdict.by}",
        )
        for client, fate in verdict.fates:
            yield f"client {client}", fate if fate in MISSED else IN_TIME


def _of_moment(moment: Moment) -> Iterator[tuple[str, str]]:
    for name, since in moment.history.modules.items():
        yield f"module {name}", str(since.value)
    for name, since in moment.history.sensors.items():
        yield f"sensor {name}", str(since.value)


class Span(NamedTuple):
    """Frames from `start` on in which a condition holds, up to `end`; None if it holds to the end."""

    start: Change
    end: Change | None


def spans(track: list[Change], value: str, *, negated: bool = False) -> Iterator[Span]:
    """Yield where a track has a value or, if `negated`, another known value."""
    start: Change | None = None
    for change in track:
        holds = change.value not in (value, UNKNOWN) if negated else change.value == value
        if holds and start is None:
            start = change
        if not holds and start is not None:
            yield Span(start, change)
            start = None
    if start is not None:
        yield Span(start, None)
