"""The text of an audit's result, for people."""

from __future__ import annotations

from collections.abc import Iterator

from colony.analysis.report import AuditReport, Difference
from colony.ir.frame import Decision
from colony.ir.program import Actuator, Program
from colony.ir.site import Site
from colony.runtime.observe.summary import SHADOW_TEXT
from colony.runtime.recordings.recorded import RecordingReader
from colony.text.wording import counted, time_text

_PARTS = {
    "wins": "wins",
    "active": "active, overridden",
    "inactive": "inactive",
    "silent": "silent: reads something missing",
}


def render(
    name: str, reader: RecordingReader, program: Program, report: AuditReport, *, file: str | None
) -> str:
    """Return the result for the recording `name`, audited by `program`, which comes from `file`."""
    run, truncation = reader.run, reader.truncation
    subject = f"{run.program or program.robot.name}, seed {run.seed}" if run else program.robot.name
    title = f"{subject}, run {run.run}" if run and run.run else subject
    by = f", by {file}" if file else ""
    lines = [
        f"{name}: {title}{by}, {counted(report.frames, 'frame')}"
        f" from 0 s to {time_text(report.last_ns - report.first_ns)}",
        *([f"  {SHADOW_TEXT}"] if reader.shadow else []),
        *_indented(_site(program.site, None if run is None else run.site)),
        *_indented(_counts(report)),
        *_indented(_contracts(report, program)),
        *([f"  truncated: {truncation}; audited as far as it goes"] if truncation else []),
        *_indented(iter(reader.remarks)),
        *_indented(_damage(report)),
    ]
    if report.first is None:
        compared = "compared " if report.unknown or report.damaged or report.forgotten else ""
        where = ", as far as the recording is not damaged" if report.damaged else ""
        return "\n".join([*lines, f"agrees: every decision {compared}is the interpreter's{where}"])
    differing = counted(report.differing, "frame")
    return "\n".join(
        [
            *lines,
            f"DIFFERS in {differing}, first {_location_text(report.first, report.first_ns)}",
            *_first_difference(report, program),
        ]
    )


def _indented(lines: Iterator[str]) -> Iterator[str]:
    return (f"  {line}" for line in lines)


def _site(site: Site | None, recorded: Site | None) -> Iterator[str]:
    if site is not None:
        values = ", ".join(f"{name} = {value}" for name, value in site.values)
        unproved = " (the run was not proved with them)" if recorded and recorded.proved is None else ""
        yield f"params of {site.file}: {values}{unproved}"


def _counts(report: AuditReport) -> Iterator[str]:
    yield f"{counted(report.compared, 'decision')} compared"
    frame_counts = {
        "late clients": report.late,
        "lost clients": report.lost,
        "refused requests": report.refused,
        "two commands at once": report.violations,
        "a command from outside the network": report.outside,
        "the emergency stop or a lock on": report.holds,
    }
    for what, frames in frame_counts.items():
        if frames:
            yield f"{counted(frames, 'frame')} with {what}"
    if report.idled:
        yield f"{counted(report.idled, 'decision')} idle for want of a client"
    for server, decisions in report.unheard_by_server.items():
        yield f"{counted(decisions, 'decision')} of {server} not recorded"
    if report.unknown:
        yield f"{counted(report.unknown, 'frame')} not compared: a frame before them was not observed"
    if report.restarts:
        yield f"{counted(report.restarts, 'restart')}"


def _damage(report: AuditReport) -> Iterator[str]:
    for span in report.damaged:
        start = "" if span.after_ns is None else f" from {time_text(span.after_ns - report.first_ns)}"
        end = "to its end" if span.before_ns is None else f"to {time_text(span.before_ns - report.first_ns)}"
        yield f"damaged{start} {end}: left out"
    if report.resumed:
        yield "after that, audited from the recorded memory"
    if report.forgotten:
        yield f"{counted(report.forgotten, 'frame')} not compared: the memory before them is unknown"
    if report.undecided:
        yield f"{counted(report.undecided, 'decision')} not compared: what lost clients changed is unknown"


def _contracts(report: AuditReport, program: Program) -> Iterator[str]:
    unbroken_count = len(program.contracts) - len(report.contracts)
    if unbroken_count:
        yield f"{counted(unbroken_count, 'contract')} held in every frame"
    begin_ns = report.first_ns
    for c in report.contracts:
        span = f"first at {time_text(c.first_ns - begin_ns)}, last at {time_text(c.last_ns - begin_ns)}"
        yield f"contract {c.contract}: BROKEN in {counted(c.frames, 'frame')}, {span}"


def _location_text(first: Difference, begin_ns: int) -> str:
    actuator = "" if first.actuator is None else f", {first.actuator}"
    return f"at {time_text(first.t_ns - begin_ns)} (frame {first.k}){actuator}: {first.message}"


def _first_difference(report: AuditReport, program: Program) -> Iterator[str]:
    """Yield the first difference in detail."""
    first = report.first
    if first is None or first.recorded is None or first.expected is None:
        return
    actuator = next(a for a in program.robot.actuators if a.name == first.actuator)
    yield f"  recorded:    {_decision(first.recorded, actuator)}"
    yield f"  interpreter: {_decision(first.expected, actuator)}"
    width = max((len(c.client) for c in first.clients), default=0)
    for c in first.clients:
        recorded = "" if c.fate is None else f"; recorded: {c.fate}"
        yield f"    {c.client:{width}}  {_PARTS[c.part]}{recorded}"
    if first.missing:
        yield f"  missing in this frame: {', '.join(first.missing)}"


def _decision(decision: Decision, actuator: Actuator) -> str:
    values = decision.values
    if values is None:
        sent = "nothing sent"
    elif len(values) == len(actuator.fields):
        sent = ", ".join(f"{f.name} = {x!r}" for f, x in zip(actuator.fields, values, strict=True))
    else:
        sent = repr(values)
    fault = f" ({decision.fault})" if decision.fault else ""
    return f"by {decision.by or '(nobody)'}, {sent}{fault}"
