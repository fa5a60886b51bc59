"""The output of `colony verify`: text during the work, or JSON or SARIF at the end."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, assert_never

import click

from colony.cli.reporting import Format, is_unreadable, one_line, report, say
from colony.cli.verify.work import Verified
from colony.text.wording import counted

if TYPE_CHECKING:
    from colony.cli.sarif import TraceStep
    from colony.text.diagnostics import Diagnostic


def show(one: Verified) -> None:
    """Print a line per contract with any refuting run, and the diagnostics on standard error."""
    if one.program is None:
        if is_unreadable(one.found):
            say(one_line(one.found[0]))
        else:
            report(one.found)
        return
    from colony.verify.contracts.prove import in_order
    from colony.verify.contracts.report import lines

    if not one.program.contracts:
        click.echo(f"{one.file}: there are no contracts")
    for result in in_order(one.program, one.results):
        head, *below = lines(one.program, result)
        click.echo(f"{one.file}: {head}")
        for line in below:
            click.echo(f"  {line}")
    if one.report is not None:
        from colony.cli.verify.examples import lines as tried

        for line in tried(one.program, one.report, one.known):
            click.echo(f"{one.file}: {line}" if not line.startswith(" ") else f"  {line}")
    if one.left_open:
        click.echo(f"{one.file}: {_left_open(one)}")
    report(one.found)


def _left_open(one: Verified) -> str:
    many = "s" if one.left_open > 1 else ""
    return (
        f"there was no time for {one.left_open} question{many} about what can never act; --timeout gives more"
    )


def close(done: Sequence[Verified], format_: Format, interrupted: bool = False) -> None:
    """Print the end of the output: a summary as text, or everything as JSON or SARIF."""
    match format_:
        case "text":
            _summary(done, interrupted)
        case "json":
            click.echo(_json(done, interrupted))
        case "sarif":
            click.echo(_sarif(done))
        case _:
            assert_never(format_)


def _summary(done: Sequence[Verified], interrupted: bool) -> None:
    from colony.verify.contracts.report import verdict

    verdicts = [verdict(r).lower() for one in done for r in one.results]
    if not any(one.program for one in done):
        return
    counts = [f"{verdicts.count(word)} {word}" for word in ("proved", "refuted", "unknown")]
    warnings = sum(d.severity == "warning" for one in done for d in one.found)
    counts += [counted(warnings, "warning")] if warnings else []
    click.echo(", ".join(counts) + (": interrupted before the end" if interrupted else ""))


def _json(done: Sequence[Verified], interrupted: bool) -> str:
    from colony.text.diagnostics import to_rows
    from colony.verify.contracts.prove import in_order
    from colony.verify.contracts.report import row

    files: list[dict[str, object]] = []
    for one in done:
        results = in_order(one.program, one.results) if one.program else []
        contracts = [row(one.program, r) for r in results] if one.program else []
        made: dict[str, object] = {"file": one.file, "contracts": contracts}
        if one.program is not None and one.report is not None:
            from colony.cli.verify.examples import row as tried

            made["examples"] = tried(one.program, one.report)
        files.append({**made, "left_open": one.left_open, "diagnostics": to_rows(one.found)})
    return json.dumps({"interrupted": interrupted, "files": files}, indent=2)


def _sarif(done: Sequence[Verified]) -> str:
    from colony.cli.sarif import sarif

    found = [d for one in done for d in one.found]
    traces: dict[Diagnostic, Sequence[TraceStep]] = {}
    for one in done:
        traces |= _traces(one)
    bugs = [bug for one in done if (bug := one.bug) is not None]
    return sarif(found, directory=Path.cwd(), command="verify", traces=traces, bugs=bugs)


def _traces(one: Verified) -> dict[Diagnostic, Sequence[TraceStep]]:
    """Return the frames that lead to each finding of a file."""
    from colony.cli.sarif import TraceStep
    from colony.cli.verify import examples
    from colony.verify.contracts.report import finding, told_frames
    from colony.verify.contracts.results import Proved

    made: dict[Diagnostic, Sequence[TraceStep]] = {}
    if one.program is None:
        return made
    for result in one.results:
        diagnostic = finding(result, one.offered)
        if diagnostic is not None and not isinstance(result, Proved) and result.trace is not None:
            span = result.contract.span
            made[diagnostic] = [
                TraceStep(span, happens, given)
                for happens, given in told_frames(one.program, result.trace.snapshots, result.trace.outcomes)
            ]
    if one.report is not None:
        made |= examples.findings(one.program, one.report, one.offered, one.known)
    return made
