"""`colony audit`: a recorded run, compared with the reference interpreter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from colony.cli.exit_codes import EXIT_ERRORS
from colony.cli.params_choice import params_option
from colony.cli.progress import ReadingProgress
from colony.cli.recorded import program_for
from colony.cli.reporting import refuse, report
from colony.cli.robot_choice import description_option
from colony.cli.shipped_files import BEHAVIOR
from colony.ir.version import SEMANTICS

if TYPE_CHECKING:
    from colony.analysis.report import AuditReport
    from colony.ir.program import Program
    from colony.runtime.recordings.recorded import RecordingReader


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

    A recording of `colony run --shadow` has what would have been sent, and the result says so.

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
        from colony.cli.audit_text import render

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
