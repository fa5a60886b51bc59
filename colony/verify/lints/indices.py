"""Lint of computed indices that are not proved to be inside their arrays.

The finding is an error where the element decides what the robot does: in a predicate, a limit or a
transition. There an index outside, whose element is NaN or false, silently decides as if nothing were there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from colony.ir.expression import Expression, SensorValue, Window, children, subexpressions
from colony.ir.types import Quantity
from colony.text.diagnostics import Diagnostic, Label, Severity
from colony.text.source import Span
from colony.text.wording import counted, degrees_text, one_line, quoted
from colony.verify.contracts.decimals import seconds
from colony.verify.contracts.prove import Prover
from colony.verify.contracts.report import reason_text
from colony.verify.contracts.results import (
    OverReals,
    Proved,
    ProvedInTime,
    Refuted,
    Result,
    Trace,
    Unknown,
)
from colony.verify.lints.accesses import Access, accesses
from colony.verify.lints.case import Case
from colony.verify.lints.evidence import frames, replay
from colony.verify.lints.finding import Finding, Run
from colony.verify.lints.proof import OPTIONS, Effort
from colony.verify.symbolic.system import Reason, Shape


def findings(case: Case, effort: Effort, shapes: dict[str, Shape]) -> Iterator[Finding]:
    """Yield an error or a warning for each computed index that is not proved to be inside.

    `shapes` are those found for the program's memory so far.
    One that is proved only over real numbers gets a note. An index in a function counts once a call.
    """
    instrumented, found = accesses(case.program)
    if not found:
        return
    prover, reported = Prover(instrumented, OPTIONS, effort, shapes=shapes), set[tuple[Span, ...]]()
    for access in sorted(found, key=lambda access: not access.decides):
        place = (access.place.span, *_arguments(access.place, access.place.span))
        if place in reported or not effort.allows_question():
            continue
        result = prover.prove_disturbed(access.claim)
        finding = _finding(case, access, result)
        if finding is not None:
            reported.add(place)
            yield finding


def _arguments(e: Expression, body: Span) -> Iterator[Span]:
    """Yield the spans of what a call puts into a place with the span `body`: arguments for parameters."""
    if e.span.source is body.source and body.start <= e.span.start and e.span.end <= body.end:
        for part in children(e):
            yield from _arguments(part, body)
    else:
        yield e.span


def _finding(case: Case, access: Access, result: Result) -> Finding | None:
    """Return the finding about an index, None if it is proved to be inside."""
    match result:
        case Proved():
            return None
        case OverReals(in_time=in_time):
            return _proved_over_reals(case, access, in_time.over_reals)
        case Refuted(trace=trace):
            return _outside(case, access, trace)
        case ProvedInTime(trace=late, python_trace=with_python, because=because):
            run = late or with_python
            return _unproved(case, access, because) if run is None else _outside(case, access, run)
        case Unknown(trace=with_python, because=because):
            return (
                _unproved(case, access, because)
                if with_python is None
                else _outside(case, access, with_python)
            )


def _outside(case: Case, access: Access, trace: Trace) -> Finding:
    """Return the finding of a run in whose last frame an index is outside."""
    shown = _shown(case, access, trace)
    length = counted(len(trace.snapshots), "frame")
    at = f"at {seconds(trace.snapshots[-1].t_ns)} of a run of {length}"
    what = f"{_noun(access)} is {shown} {at}" if shown is not None else f"{_noun(access)} is outside {at}"
    if access.angle is not None:
        message = f"`{_text(access)}` can look where there is no element: {what}"
    elif access.place.wraps:
        message = f"`{_text(access)}` can have an index that is not finite: {what}"
    else:
        message = f"`{_text(access)}` can be outside the array: {what}, the last index {access.size - 1}"
    found = Trace(
        snapshots=trace.snapshots,
        outcomes=replay(case.program, trace.snapshots),
        needed_missing=trace.needed_missing,
        could_change=trace.could_change,
        found=() if shown is None else (f"{_noun(access)} of {_text(access)}: {shown}",),
    )
    actuator = None if access.owner is None else access.owner.actuator
    return Finding(_diagnostic(case, access, message), Run(_text(access), actuator, found))


def _unproved(case: Case, access: Access, because: tuple[str, ...]) -> Finding:
    reasons = "; ".join(line.strip() for line in because)
    message = f"`{_text(access)}` is not proved to be inside the array: {reasons}"
    return Finding(_diagnostic(case, access, message))


def _proved_over_reals(case: Case, access: Access, reasons: tuple[Reason, ...]) -> Finding:
    """Return the note that a proof takes floats as real numbers."""
    because = "; ".join(dict.fromkeys(map(reason_text, reasons)))
    message = f"`{_text(access)}` is proved to be inside the array only over real numbers: {because}"
    return Finding(replace(_diagnostic(case, access, message), severity="note"))


def _shown(case: Case, access: Access, trace: Trace) -> str | None:
    """Return the index in the last frame of a run, None if the interpreter cannot give it."""
    if not access.is_shown:
        return None
    *_, (_, interpreter) = frames(case.program, trace.snapshots)
    value = interpreter.value_of(access.index)
    if not isinstance(value, float):
        return None
    return f"{value:.10g}" if access.angle is None else degrees_text(value)


def _noun(access: Access) -> str:
    if access.angle is not None:
        return "the angle"
    return "the center" if isinstance(access.place, Window) else "the index"


def _text(access: Access) -> str:
    return one_line(access.place.span.text)


def _diagnostic(case: Case, access: Access, message: str) -> Diagnostic:
    severity: Severity = "error" if access.decides else "warning"
    span, hint = access.place.span, _hint(case, access)
    labels = tuple(Label(s, "together with this") for s in dict.fromkeys(_arguments(access.place, span)))
    return Diagnostic(code="V036", span=span, message=message, hint=hint, severity=severity, labels=labels)


def _hint(case: Case, access: Access) -> str:
    """Return how to keep the index inside, or say what stands for an element that is outside."""
    unbounded = [] if isinstance(access.place, Window) else list(_without_range(case, access))
    ranges = f"; or give {quoted(unbounded)} a range" if unbounded else ""
    return f"{_inside_or_else(access)}{ranges}"


def _without_range(case: Case, access: Access) -> Iterator[str]:
    """Yield the scalar sensors that an index reads itself and that have no range."""
    read = {e.name for e in subexpressions(access.index) if isinstance(e, SensorValue)}
    for sensor in case.program.robot.sensors:
        is_scalar = sensor.sent is None and isinstance(sensor.type, Quantity)
        if sensor.name in read and is_scalar and sensor.low is None and sensor.high is None:
            yield sensor.name


def _inside_or_else(access: Access) -> str:
    text, index = _text(access), one_line(access.index.span.text)
    last = access.size - 1
    if isinstance(access.place, Window):
        if access.place.wraps:
            return "bound what the center reads, so that it is finite"
        reach = access.place.reach
        return f"keep the center inside, as in `clamp({index}, {reach}, {last - reach})`"
    or_else = f"say what stands for an element outside: `value_or({text}, ...)`"
    if access.angle is not None or access.place.wraps:
        return or_else
    return f"{or_else}; or keep the index inside, as in `clamp({index}, 0, {last})`"
