"""What changed in a recording, and when: a track for each module, sensor, actuator and client."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from colony.ir.frame import MISSED
from colony.ir.program import Program
from colony.runtime.frames.run_frame import RunFrame
from colony.text.wording import did_you_mean
from colony.verify.explain.moment import Moment


class TrackChange(NamedTuple):
    """A value that a track has from a frame on."""

    t_ns: int
    k: int
    value: str


Tracks = dict[str, list[TrackChange]]
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
                track.append(TrackChange(t_ns, k, value))


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


class FrameSpan(NamedTuple):
    """Frames from `start` on in which a condition holds, up to `end`; None if it holds to the end."""

    start: TrackChange
    end: TrackChange | None


def spans(track: list[TrackChange], value: str, *, negated: bool = False) -> Iterator[FrameSpan]:
    """Yield where a track has a value or, if `negated`, another known value."""
    start: TrackChange | None = None
    for change in track:
        holds = change.value not in (value, UNKNOWN) if negated else change.value == value
        if holds and start is None:
            start = change
        if not holds and start is not None:
            yield FrameSpan(start, change)
            start = None
    if start is not None:
        yield FrameSpan(start, None)


# --- conditions ------------------------------------------------------------------------------------


class Condition(NamedTuple):
    """A condition on a track of the index; `subject` is the name that it is about."""

    subject: str
    track: str
    value: str
    negated: bool = False


FORMS = (
    "`ACTUATOR by MODULE`, `ACTUATOR is idle` (or commanded, or outside), `MODULE is active` (or inactive, "
    "silent, blind, late, lost, refused), `SENSOR is missing` (or present), each also with `is not`"
)
"""The forms of conditions, for messages."""

_BY = re.compile(r"(?P<subject>[\w.]+)\s+by\s+(?P<value>[\w.]+)")
_IS = re.compile(r"(?P<subject>[\w.]+)\s+is\s+(?P<negated>not\s+)?(?P<value>\w+)")

_MODULE = ("active", "inactive", "silent", "blind")
_CLIENT = ("late", "lost", "refused")
_SENSOR = ("missing", "present")
CONDITIONS = ("idle", "commanded", "outside", *_MODULE, *_CLIENT, *_SENSOR)
"""The words after `is`."""


class ConditionError(ValueError):
    """A text is no condition of this program; the message says why."""


def condition(program: Program, text: str) -> Condition:
    """Return the condition that a text is.

    Raises:
        ConditionError: it has none of the forms, or a name that the program lacks.
    """
    modules = [m.name for m in program.modules]
    actuators = [a.name for a in program.robot.actuators]
    sensors = [s.name for s in program.robot.sensors if s.sent is None]
    if by := _BY.fullmatch(text.strip()):
        subject = _known(by["subject"], actuators, "actuator")
        return Condition(subject, f"actuator {subject}", f"by {_known(by['value'], modules, 'module')}")
    found = _IS.fullmatch(text.strip())
    if found is None:
        raise ConditionError(f"found `{text}`; expected {FORMS}")
    subject, value, negated = found["subject"], found["value"], found["negated"] is not None
    match value:
        case "idle" | "outside":
            name = _known(subject, actuators, "actuator")
            return Condition(name, f"actuator {name}", IDLE if value == "idle" else OUTSIDE, negated)
        case "commanded":
            name = _known(subject, actuators, "actuator")
            return Condition(name, f"actuator {name}", IDLE, not negated)
        case _ if value in _MODULE or value in _CLIENT:
            name = _known(subject, modules, "module")
            kind = "module" if value in _MODULE else "client"
            return Condition(name, f"{kind} {name}", value, negated)
        case _ if value in _SENSOR:
            name = _known(subject, sensors, "sensor")
            return Condition(name, f"sensor {name}", value, negated)
        case _:
            raise ConditionError(f"found `{text}`; expected {FORMS}")


def _known(name: str, names: list[str], kind: str) -> str:
    if name in names:
        return name
    hint = did_you_mean(name, names) or f"the program has {', '.join(names) or 'none'}"
    raise ConditionError(f"no {kind} `{name}`; {hint}")


def spans_of(tracks: Tracks, condition: Condition, from_ns: int | None = None) -> Iterator[FrameSpan]:
    """Yield the spans of frames in which a condition holds, those that begin at `from_ns` or later."""
    for span in spans(tracks.get(condition.track, []), condition.value, negated=condition.negated):
        if from_ns is None or span.start.t_ns >= from_ns:
            yield span
