"""`colony test`: the tests in behavior files, run in the reference interpreter."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.frame_picture import check_picture, draw_test
from colony.cli.outputs import BEHAVIOR
from colony.cli.params_choice import params_option
from colony.cli.reporting import check_to_run, is_unreadable, one_line, report, say
from colony.cli.robot_choice import description_option
from colony.text.wording import counted

if TYPE_CHECKING:
    from colony.ir.program import Program
    from colony.text.diagnostics import Diagnostic
    from colony.verify.explain.answer import Explanation
    from colony.verify.testing.examples import ExampleResult


@click.command("test", short_help="run the tests that behavior files contain")
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=BEHAVIOR)
@description_option()
@params_option()
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
@click.option(
    "--only",
    multiple=True,
    metavar="NAME",
    help="Run only the tests whose names contain NAME. May be repeated.",
)
@click.option("--explain", is_flag=True, help="Below each test that fails, show which conditions decided.")
@click.option(
    "--picture",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PATH",
    help="Draw a frame of the one test that is run, PNG or SVG: the arrays with bearings around the robot, "
    "and the decisions.",
)
@click.option(
    "--frame",
    "frame_number",
    type=click.IntRange(min=0),
    metavar="N",
    help="The frame to draw, counted from 0. [default: the first in which the test fails, else the last]",
)
def command(
    files: tuple[str, ...],
    format_: str,
    only: tuple[str, ...],
    explain: bool,
    picture: Path | None,
    frame_number: int | None,
) -> None:
    """Run every `test` block, and check all contracts in each of its frames.

    Exit code: 0 if all tests pass, 1 if a test fails or a file has errors, 2 if a file cannot be read or
    --only matches no test.

    \b
    Example:
      colony test wander
      colony test wander --only bump
      colony test patrol.colony --explain
      colony test wander --only middle --picture middle.png
    """
    drawing = _checked_drawing(files, picture, frame_number)
    passed = failed = 0
    unreadable = False
    diagnostics: list[Diagnostic] = []
    answers: list[Explanation | None] = []
    for file in files:
        tested = _test(file, only, explain=explain)
        passed, failed = passed + tested.passed, failed + tested.failed
        unreadable = unreadable or is_unreadable(tested.diagnostics)
        diagnostics += tested.diagnostics
        answers += tested.answers or [None] * len(tested.diagnostics)
        if format_ == "text":
            for line in tested.lines:
                click.echo(line)
            if is_unreadable(tested.diagnostics):
                say(one_line(tested.diagnostics[0]))
            else:
                report(tested.diagnostics)
    if format_ == "json":
        click.echo(_as_json(diagnostics, answers if explain else None))
    elif passed or failed or not (diagnostics or only):
        click.echo(f"{passed} passed, {failed} failed" + ("" if passed or failed else ": no tests found"))
    if only and not (passed or failed or diagnostics):
        names = " or ".join(f"`{name}`" for name in only)
        raise click.UsageError(f"no test has {names} in its name", click.get_current_context())
    if drawing is not None and tested.program is not None:
        with redirect_stdout(sys.stderr):
            draw_test(drawing.picture, tested.program, files[0], tested.results, drawing.frame_number)
    if unreadable:
        raise click.exceptions.Exit(EXIT_MISUSE)
    if diagnostics:
        raise click.exceptions.Exit(EXIT_ERRORS)


class _Tested(NamedTuple):
    """The results of one file's tests: the diagnostics, a line per test, and the tests that were run."""

    diagnostics: Sequence[Diagnostic]
    lines: Sequence[str] = ()
    passed: int = 0
    failed: int = 0
    program: Program | None = None
    results: Sequence[ExampleResult] = ()
    answers: Sequence[Explanation | None] = ()


class _Drawing(NamedTuple):
    """A picture to be drawn, and the number of its frame."""

    picture: Path
    frame_number: int | None


def _checked_drawing(
    files: tuple[str, ...], picture: Path | None, frame_number: int | None
) -> _Drawing | None:
    if picture is None:
        if frame_number is not None:
            message = "--frame chooses the frame that --picture draws; found no --picture"
            raise click.UsageError(message, click.get_current_context())
        return None
    if len(files) > 1:
        message = f"--picture draws a frame of one test; found {len(files)} files"
        raise click.UsageError(message, click.get_current_context())
    check_picture(picture, files)
    return _Drawing(picture, frame_number)


def _as_json(diagnostics: Sequence[Diagnostic], answers: Sequence[Explanation | None] | None) -> str:
    """Return the diagnostics as JSON, each with its `explanation` if there are answers."""
    import json

    from colony.text.diagnostics import to_json
    from colony.verify.explain.json_rows import row

    text = to_json(diagnostics)
    if answers is None:
        return text
    rows = json.loads(text)
    for member, answer in zip(rows, answers, strict=True):
        member["explanation"] = None if answer is None else row(answer)
    return json.dumps(rows, indent=2)


def _explained(program: Program, result: ExampleResult) -> list[Explanation | None]:
    """Return an answer for each failure of a test."""
    from colony.verify.explain.answer import explain_failure

    example = next(e for e in program.tests if e.span == result.span)
    return [explain_failure(program, example, failure) for failure in result.failures]


def _test(file: str, only: tuple[str, ...], *, explain: bool) -> _Tested:
    from colony.runtime.observe.summary import breach_text
    from colony.text.diagnostics import DiagnosticError
    from colony.verify.explain.text import lines as text_lines
    from colony.verify.testing.examples import failures_as_diagnostics, run_examples

    checked = check_to_run(file)
    if checked.program is None:
        return _Tested(checked.diagnostics)
    try:
        with redirect_stdout(sys.stderr):  # for prints of Python modules
            results = run_examples(checked.program, only)
            answers = [_explained(checked.program, result) if explain else [] for result in results]
    except DiagnosticError as failure:
        return _Tested(failure.diagnostics)
    lines = []
    for result, of_result in zip(results, answers, strict=True):
        verdict = "passed" if result.passed else "FAILED"
        frames = counted(result.frames, "frame")
        lines.append(f"{file}: {verdict}: {result.name} ({frames})")
        for name, count in result.assumptions.items():
            lines.append(f"  {breach_text(name, assumed=True)} in {counted(count, 'frame')}")
        lines += [f"  {line}" for answer in of_result if answer is not None for line in text_lines(answer)]
    passed = sum(result.passed for result in results)
    failed = len(results) - passed
    return _Tested(
        failures_as_diagnostics(results),
        lines,
        passed,
        failed,
        checked.program,
        results,
        [answer for of_result in answers for answer in of_result],
    )
