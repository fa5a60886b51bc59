"""`colony audit`: a recorded run, compared with the reference interpreter."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

from colony.analysis.report import AuditReport, Difference
from colony.cli.exit_codes import EXIT_ERRORS
from colony.cli.outputs import BEHAVIOR
from colony.cli.params_choice import params_option
from colony.cli.progress import ReadingProgress
from colony.cli.recorded import program_for
from colony.cli.reporting import refuse, report
from colony.cli.robot_choice import description_option
from colony.ir.frame import Decision
from colony.ir.program import Actuator, Program
from colony.ir.site import Site
from colony.ir.version import SEMANTICS
from colony.runtime.observe.summary import SHADOW_TEXT, breach_text
from colony.runtime.recordings.recorded import RecordingReader
from colony.text.wording import counted, time_text

if TYPE_CHECKING:
    from colony.analysis.report import AuditReport
    from colony.ir.program import Program
    from colony.runtime.recordings.recorded import RecordingReader


# --- audit text ----------------------------------------------------------------------------------------
#
# The text of an audit's result, for people.


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
    contracts = [c for c in program.contracts if not c.is_assumption]
    unbroken_count = len(contracts) - sum(not c.assumed for c in report.contracts)
    if unbroken_count:
        yield f"{counted(unbroken_count, 'contract')} held in every frame"
    begin_ns = report.first_ns
    for c in report.contracts:
        span = f"first at {time_text(c.first_ns - begin_ns)}, last at {time_text(c.last_ns - begin_ns)}"
        yield f"{breach_text(c.contract, assumed=c.assumed)} in {counted(c.frames, 'frame')}, {span}"


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


# --- audit ---------------------------------------------------------------------------------------------


@click.command("audit", short_help="compare a recorded run with the reference interpreter")
@click.argument("recording", metavar="RECORDING")
@click.argument("file", metavar="[FILE]", required=False, type=BEHAVIOR)
@description_option()
@params_option()
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def command(recording: str, file: str | None, format_: str) -> None:
    """Decide every frame of a recording again, and show the first frame decided differently.

    The program is taken from the recording. A recording as JSON lines does not contain its program: give
    the program as FILE. The params of a site are taken from it, or from --params if it is given.

    If a client was late or lost, the idle command is accepted as well. Frames in which a connection from
    outside the network commanded, or in which the emergency stop or a lock was on, are counted; what was sent
    from outside must be within the limits of its frame, unless the connection ignored them. A truncated
    recording is audited up to its end, a damaged one before and after the damage.

    A recording of `colony shadow` has what would have been sent, and the result says so.

    Modules in Python are not run: the recording contains their answers.

    Exit code: 0 if every frame agrees, 1 if a frame differs or the recording is damaged, 2 for misuse, such
    as a file that is not a recording.

    \b
    Example:
      colony run wander --map loop --record run.mcap
      colony audit run.mcap
      colony audit run.mcap changed.colony
    """
    from colony.text.diagnostics import DiagnosticError

    try:
        reader, program, result = audited(recording, file)
    except DiagnosticError as failure:
        code = failure.diagnostics[0].code
        if code[0] in "AF" and code != "A006":
            refuse(failure.diagnostics)
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_ERRORS) from None
    if format_ == "json":
        _print_json(recording, reader, program, result, file)
    else:
        from colony.cli.audit import render

        click.echo(render(recording, reader, program, result, file=file))
    if not result.agrees or result.damaged:
        raise click.exceptions.Exit(EXIT_ERRORS)


def audited(recording: str, file: str | None = None) -> tuple[RecordingReader, Program, AuditReport]:
    """Audit a recording by the program of `file`, or by its own.

    Raises:
        DiagnosticError: it cannot be audited, or there is nothing to compare.
    """
    from colony.analysis.audit import audit_recording
    from colony.analysis.recording import OpenRecording

    with OpenRecording.at(recording) as opened:
        program, reader = program_for(opened, file), opened.reader
        result = audit_recording(program, reader, ReadingProgress(opened.stream))
        _refuse_empty(recording, reader, result)
    return reader, program, result


def _refuse_empty(recording: str, reader: RecordingReader, result: AuditReport) -> None:
    """Raise A003 (or A006, for a damaged recording) if there was nothing to compare."""
    from colony.text.diagnostics import DiagnosticError, error
    from colony.text.source import Source, Span

    if result.frames and result.compared + result.outside + result.holds:
        return
    message = "the recording contains no decision" if result.frames else "the recording contains no frame"
    if result.damaged:
        raise DiagnosticError(
            [error("A006", Span(Source(recording, ""), 0, 0), f"{message} that can be compared")]
        )
    remarks = "; ".join([*([reader.truncation] if reader.truncation else []), *reader.remarks])
    message = f"{message} that can be compared: {remarks}" if remarks else message
    raise DiagnosticError([error("A003", Span(Source(recording, ""), 0, 0), message)])


def _print_json(
    recording: str, reader: RecordingReader, program: Program, result: AuditReport, file: str | None
) -> None:
    import json

    run = reader.run
    summary = {
        "recording": recording,
        "file": file,
        "program": run.program if run else None,
        "semantics": SEMANTICS,
        "robot": program.robot.name,
        "seed": run.seed if run else None,
        "run": run.run if run else None,
        "shadow": reader.shadow,
        "truncated": reader.truncation,
        "remarks": list(reader.remarks),
        "params": None if program.site is None else dict(program.site.values),
        "params_hash": None if program.site is None else program.site.hash,
    }
    click.echo(json.dumps(summary | result.as_json(), indent=2))
