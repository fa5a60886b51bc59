"""The output of `colony verify`: text during the work, or JSON or SARIF at the end."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, assert_never

import click

from colony.cli.reporting import Format, is_unreadable, one_line, report, say
from colony.cli.verify.work import Verified
from colony.ir.version import SEMANTICS
from colony.text.wording import counted

if TYPE_CHECKING:
    from colony.cli.sarif import TraceStep
    from colony.ir.program import Program
    from colony.text.diagnostics import Diagnostic
    from colony.text.source import Span
    from colony.verify.contracts.margins import Margin
    from colony.verify.contracts.results import Result, Trace


def show_result(verified: Verified, result: Result) -> None:
    """Print the line of a contract, with any refuting run."""
    from colony.verify.contracts.report import lines

    assert verified.program is not None
    head, *below = lines(verified.program, result)
    click.echo(f"{verified.file}: {head}")
    for line in below:
        click.echo(f"  {line}")


def show_rest(verified: Verified) -> None:
    """Print what was found besides the results of contracts, and the diagnostics on standard error."""
    if verified.program is None:
        if is_unreadable(verified.diagnostics):
            say(one_line(verified.diagnostics[0]))
        else:
            report(verified.diagnostics)
        return
    from colony.verify.lints.proof import run_lines

    if not verified.program.contracts and not verified.program.reaches:
        click.echo(f"{verified.file}: no contracts found")
    for finding in verified.findings:
        for line in run_lines(verified.program, finding):
            click.echo(f"{verified.file}: {line}" if not line.startswith(" ") else f"  {line}")
    _show_margins(verified)
    if verified.report is not None:
        from colony.cli.verify.examples import lines as example_lines

        for line in example_lines(verified.program, verified.report, verified.refuted_names):
            click.echo(f"{verified.file}: {line}" if not line.startswith(" ") else f"  {line}")
    if verified.undecided_questions:
        click.echo(f"{verified.file}: {_undecided_text(verified)}")
    report(_without_repetition(verified))


def _show_margins(verified: Verified) -> None:
    """Print the table of margins, and the runs at their ends."""
    from colony.verify.contracts.margins import amount_text, margin_lines
    from colony.verify.contracts.table import table

    if not verified.margins:
        return
    click.echo(f"{verified.file}: margins of the readings of sensors; other sensors may read anything:")
    for line in margin_lines(verified.margins):
        click.echo(f"  {line}")
    for m in verified.margins if verified.shows_runs else ():
        if m.program is not None and m.trace is not None:
            click.echo(f"{m.contract.name} with `{m.sensor.name}` {amount_text(m, m.refuted)}:")
            for line in table(m.program, m.contract, m.trace):
                click.echo(f"    {line}")


def _margin_row(m: Margin) -> dict[str, object]:
    """Return a margin as an object for JSON: amounts in the unit of the sensor, or numbers of readings."""
    from colony.verify.contracts.report import trace_rows

    size = m.sensor.factor if m.kind == "wrong" else 1.0
    return {
        "contract": m.contract.name,
        "sensor": m.sensor.name,
        "kind": m.kind,
        "unit": m.sensor.unit if m.kind == "wrong" else "readings",
        "proved": m.proved / size,
        "refuted": None if m.refuted is None else m.refuted / size,
        "complete": m.is_complete,
        "trace": None if m.program is None or m.trace is None else trace_rows(m.program, m.trace),
    }


def _without_repetition(verified: Verified) -> list[Diagnostic]:
    """Return the diagnostics without what is printed above them: facts of runs, and hints given before."""
    from colony.verify.contracts.report import finding

    short = {
        finding(r, verified.suggested_file): finding(r, verified.suggested_file, is_shown=True)
        for r in verified.results
    }
    diagnostics: list[Diagnostic] = []
    hints = set[str | None]()
    for diagnostic in verified.diagnostics:
        shown = short.get(diagnostic) or diagnostic
        diagnostics.append(replace(shown, hint=None) if shown.hint in hints else shown)
        hints.add(shown.hint)
    return diagnostics


def _undecided_text(verified: Verified) -> str:
    questions = counted(verified.undecided_questions, "question")
    return f"not decided within the limit: {questions} about modules that can never act; raise --timeout"


def finish_output(verified_files: Sequence[Verified], format_: Format, interrupted: bool = False) -> None:
    """Print the summary as text, or the complete output as JSON or SARIF."""
    match format_:
        case "text":
            _summary(verified_files, interrupted)
        case "json":
            click.echo(_json(verified_files, interrupted))
        case "sarif":
            click.echo(_sarif(verified_files))
        case _:
            assert_never(format_)


def _summary(verified_files: Sequence[Verified], interrupted: bool) -> None:
    from colony.verify.contracts.report import counted_as

    verdicts = [counted_as(r) for verified in verified_files for r in verified.results]
    if not any(verified.program for verified in verified_files):
        return
    over_reals = verdicts.count("over_reals")
    counts = [_proved_text(verdicts), *([f"{over_reals} over reals"] if over_reals else [])]
    counts += [f"{verdicts.count(word)} {word}" for word in ("refuted", "unknown")]
    reached = (("reached", "reached"), ("never_reached", "never reached"))
    counts += [f"{verdicts.count(key)} {words}" for key, words in reached if key in verdicts]
    errors = sum(f.diagnostic.severity == "error" for verified in verified_files for f in verified.findings)
    counts += [counted(errors, "error")] if errors else []
    warnings = sum(d.severity == "warning" for verified in verified_files for d in verified.diagnostics)
    counts += [counted(warnings, "warning")] if warnings else []
    click.echo(", ".join(counts) + (": interrupted before the end" if interrupted else ""))


def _proved_text(verdicts: Sequence[str]) -> str:
    """Return `7 proved (1 of them only while every client is in time)`."""
    in_time = verdicts.count("proved_in_time")
    proved = verdicts.count("proved") + in_time
    return f"{proved} proved" + (
        f" ({in_time} of them only while every client is in time)" if in_time else ""
    )


def _json(verified_files: Sequence[Verified], interrupted: bool) -> str:
    from colony.verify.contracts.prove import in_order
    from colony.verify.contracts.report import row

    files: list[dict[str, object]] = []
    for verified in verified_files:
        results = in_order(verified.program, verified.results) if verified.program else []
        rows = [row(verified.program, r) for r in results] if verified.program else []
        entry: dict[str, object] = {
            "file": verified.file,
            "contracts": [r for r in rows if "contract" in r],
            "reaches": [r for r in rows if "reach" in r],
        }
        if verified.program is not None and verified.report is not None:
            from colony.cli.verify.examples import row as example_row

            entry["examples"] = example_row(verified.program, verified.report)
        if verified.margins:
            entry["margins"] = [_margin_row(m) for m in verified.margins]
        files.append(
            {**entry, "left_open": verified.undecided_questions, "diagnostics": _diagnostic_rows(verified)}
        )
    return json.dumps({"semantics": SEMANTICS, "interrupted": interrupted, "files": files}, indent=2)


def _diagnostic_rows(verified: Verified) -> list[dict[str, object]]:
    """Return an object for each diagnostic, with the run that shows it as `trace` if there is one."""
    from colony.text.diagnostics import to_rows
    from colony.verify.contracts.report import trace_rows

    runs = {f.diagnostic: f.run for f in verified.findings}
    rows = to_rows(verified.diagnostics)
    for diagnostic, row in zip(verified.diagnostics, rows, strict=True):
        run = runs.get(diagnostic)
        if run is not None and verified.program is not None:
            row["trace"] = trace_rows(verified.program, run.trace)
    return rows


def _sarif(verified_files: Sequence[Verified]) -> str:
    from colony.cli.sarif import sarif

    found = [d for verified in verified_files for d in verified.diagnostics]
    traces: dict[Diagnostic, Sequence[TraceStep]] = {}
    for verified in verified_files:
        traces |= _traces(verified)
    bugs = [bug for verified in verified_files if (bug := verified.bug) is not None]
    return sarif(found, directory=Path.cwd(), command="verify", traces=traces, bugs=bugs)


def _traces(verified: Verified) -> dict[Diagnostic, Sequence[TraceStep]]:
    """Return the frames that lead to each finding of a file."""
    from colony.cli.verify import examples
    from colony.verify.contracts.report import finding
    from colony.verify.contracts.results import trace_of

    traces: dict[Diagnostic, Sequence[TraceStep]] = {}
    if verified.program is None:
        return traces
    for result in verified.results:
        diagnostic = finding(result, verified.suggested_file)
        trace = trace_of(result)
        if diagnostic is not None and trace is not None:
            traces[diagnostic] = _steps(verified.program, result.contract.span, trace)
    for lint_finding in verified.findings:
        if lint_finding.run is not None:
            span, trace = lint_finding.diagnostic.span, lint_finding.run.trace
            traces[lint_finding.diagnostic] = _steps(verified.program, span, trace)
    if verified.report is not None:
        traces |= examples.findings(
            verified.program, verified.report, verified.suggested_file, verified.refuted_names
        )
    return traces


def _steps(program: Program, span: Span, trace: Trace) -> list[TraceStep]:
    """Return the frames of a run that shows a finding at `span`."""
    from colony.cli.sarif import TraceStep
    from colony.verify.contracts.report import readable_frames

    frames = readable_frames(program, trace.snapshots, trace.outcomes)
    return [TraceStep(span, event, values) for event, values in frames]
