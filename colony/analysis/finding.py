"""Finding a moment of a recording: by its time, with the index, or by a condition."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from colony.analysis.follower import Follower
from colony.analysis.index import Index, Mark
from colony.analysis.tracks import IDLE, OUTSIDE, Span, spans
from colony.ir.program import Program
from colony.runtime.recordings.recorded import RecordingReader
from colony.text.suggestions import did_you_mean
from colony.verify.explain.moment import Moment


class Found(NamedTuple):
    """The last frame at or before a time: its number, its time, and the moment; None if it is not known."""

    k: int
    t_ns: int
    moment: Moment | None


def moment_at(program: Program, reader: RecordingReader, index: Index, t_ns: int) -> Found:
    """Return the last frame at or before a time, which must not be before the first frame.

    Raises:
        StaleIndexError: the checkpoint before the frame is damaged.
        DiagnosticError: the recording cannot be read.
    """
    mark = _mark_before(index, t_ns)
    follower = Follower(program, None if mark is None else index.checkpoint(mark))
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


def spans_of(index: Index, condition: Condition, from_ns: int | None = None) -> Iterator[Span]:
    """Yield the spans of frames in which a condition holds, those that begin at `from_ns` or later."""
    for span in spans(index.tracks.get(condition.track, []), condition.value, negated=condition.negated):
        if from_ns is None or span.start.t_ns >= from_ns:
            yield span
