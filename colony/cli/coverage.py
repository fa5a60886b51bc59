"""`colony coverage`: which parts of a behavior its tests, or recordings, have exercised."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from colony.cli.exit_codes import EXIT_ERRORS
from colony.cli.outputs import BEHAVIOR, check_output, write_whole
from colony.cli.params_choice import params_option
from colony.cli.progress import ReadingProgress, proof_progress
from colony.cli.reporting import exit_with, load_program, refuse, say
from colony.cli.robot_choice import description_option
from colony.text.wording import counted, quoted

if TYPE_CHECKING:
    from colony.ir.memory import ProgramMemory
    from colony.verify.coverage.measure import Coverage, Measured
    from colony.verify.coverage.obligations import CoverageGoal, CoveragePlan, Obligation
    from colony.verify.coverage.recorder import Recorder
    from colony.verify.reference.interpreter import Interpreter

# --- text ----------------------------------------------------------------------------------------------


def share_text(coverage: Coverage) -> str:
    """Return `3 of 4 obligations covered (75.0 %)`."""
    possible = counted(coverage.possible, "obligation")
    return f"{coverage.counts()['covered']} of {possible} covered ({coverage.percent:.1f} %)"


def text_of(file: str, coverage: Coverage) -> Iterator[str]:
    """Yield the table by kinds, and what is not covered."""
    yield f"{file}: {share_text(coverage)} in {counted(coverage.frames, 'frame')}"
    rows: list[tuple[str, Iterable[object]]] = [("", coverage.counts())]
    rows += [(kind, coverage.counts(kind).values()) for kind in coverage.kinds()]
    for heading, columns in rows if coverage.measured else ():
        yield f"  {heading:10}" + "".join(f"{x!s:>12}" for x in columns)
    for state, heading in (
        ("uncovered", "uncovered, and steps that would show it"),
        ("unknown", "uncovered; neither a run nor a proof decides whether it can be covered"),
        ("impossible", "impossible, which is proved, and left out of 100 %"),
    ):
        found = [m for m in coverage.measured if m.state == state]
        if found:
            yield f"{heading}:"
        for m in found:
            yield from _lines(coverage.plan, m)


def _lines(plan: CoveragePlan, m: Measured) -> Iterator[str]:
    for i, goal in enumerate(m.unseen):
        yield f"  {m.obligation.span.place}: {lacking_text(m, goal)}"
        for line in steps_of(plan, m) if i == 0 else ():
            yield f"    {line}"


def lacking_text(m: Measured, goal: CoverageGoal) -> str:
    """Return what no frame shows, with the assumptions under which none can."""
    return f"no frame in which {goal.text}" + (f", assuming {quoted(m.assuming)}" if m.assuming else "")


def steps_of(plan: CoveragePlan, m: Measured) -> Iterator[str]:
    """Yield the steps of a test that shows the first frame that an obligation lacks, if there is a run."""
    if m.runs:
        from colony.verify.contracts.example_block import test_block

        snapshots = m.runs[0].snapshots
        block = test_block(plan.program, "", snapshots, [()] * len(snapshots))
        for line in block.splitlines()[1:-1] if block is not None else ():
            yield line.strip()


def _name(o: Obligation) -> str:
    return f"`{o.text}` of `{o.subject}`" if o.kind == "condition" else f"`{o.subject}`: {o.text}"


# --- JSON, LCOV ----------------------------------------------------------------------------------------


def row_of(file: str, coverage: Coverage) -> dict[str, object]:
    """Return the coverage as an object for JSON."""
    obligations = []
    for m in coverage.measured:
        o = m.obligation
        line, column = o.span.source.position(o.span.start)
        place = {"file": o.span.source.name, "line": line, "column": column}
        about = {"kind": o.kind, "subject": o.subject, "text": o.text, "state": m.state}
        obligations.append(
            {**about, **place, "missing": [goal.text for goal in m.unseen], "assuming": m.assuming}
        )
    kinds = {kind: coverage.counts(kind) for kind in coverage.kinds()}
    of_all = {"file": file, "percent": coverage.percent, "frames": coverage.frames}
    return {**of_all, "counts": coverage.counts(), "kinds": kinds, "obligations": obligations}


def lcov_of(coverage: Coverage) -> str:
    """Return the coverage as LCOV has it: each obligation is a branch of the line at which it begins.

    What is impossible is left out. A line counts as hit if an obligation that begins there is covered.
    """
    files: dict[str, dict[int, list[bool]]] = {}
    for m in coverage.measured:
        if m.state != "impossible":
            source = m.obligation.span.source
            line, _ = source.position(m.obligation.span.start)
            files.setdefault(source.name, {}).setdefault(line, []).append(m.state == "covered")
    text: list[str] = []
    for name, lines in sorted(files.items()):
        text += ["TN:", f"SF:{Path(name).resolve()}"]
        branches = [x for covered in lines.values() for x in covered]
        for line, covered in sorted(lines.items()):
            text += [f"BRDA:{line},0,{i},{int(x)}" for i, x in enumerate(covered)]
        text += [f"BRF:{len(branches)}", f"BRH:{sum(branches)}"]
        text += [f"DA:{line},{sum(covered)}" for line, covered in sorted(lines.items())]
        text += [f"LF:{len(lines)}", f"LH:{sum(any(c) for c in lines.values())}", "end_of_record"]
    return "".join(f"{line}\n" for line in text)


# --- what is seen --------------------------------------------------------------------------------------


def _follow(recording: str, plan: CoveragePlan, recorder: Recorder) -> None:
    """Record the goals of a recording of the program.

    Raises:
        DiagnosticError: it cannot be read, or is of another program.
    """
    from colony.analysis.follower import Follower, Interpreters, UnknownMemory, step_given
    from colony.analysis.recording import OpenRecording
    from colony.verify.coverage.recorder import with_renamed_windows

    class Instrumented(Interpreters):
        """Interpreters of the instrumented program, which resume from memory of the program itself."""

        def resume(self, memory: ProgramMemory) -> Interpreter:
            recorder.leave_out_remembering()
            return super().resume(with_renamed_windows(plan, memory))

    with OpenRecording.at(recording) as opened:
        on_frame = ReadingProgress(opened.stream)
        follower = Follower(Instrumented(replace(plan.instrumented, contracts=plan.program.contracts)))
        for frame in opened.reader.frames(plan.program):
            interpreter = follower.feed(frame)
            if not isinstance(interpreter, UnknownMemory):
                step_given(interpreter, frame)
                recorder.look(interpreter)
            on_frame()


def _with_generated(file: str, coverage: Coverage, seen: set[str]) -> Coverage:
    """Append the missing tests to a file, and return the coverage with them."""
    from colony.cli.verify.work import append_blocks
    from colony.verify.coverage.generator import generate
    from colony.verify.coverage.measure import with_seen

    generated = generate(coverage, seen)
    if generated.tests:
        append_blocks(Path(file), [test.text for test in generated.tests])
    for test in generated.tests:
        say(f'{file}: wrote the test "{test.title}"')
    for m in generated.left_out:
        why = "a run that covers it breaks a contract, or a test cannot write it"
        say(f"{m.obligation.span.place}: no test for {_name(m.obligation)}: {why}")
    frames = sum(test.frames for test in generated.tests)
    return with_seen(coverage, seen.union(*(test.goals for test in generated.tests)), frames)


def _write_files(file: str, coverage: Coverage, lcov: Path | None, html: Path | None) -> None:
    if lcov is not None:
        write_whole(lcov, lcov_of(coverage))
    if html is not None:
        from colony.cli.coverage_page import page_of

        write_whole(html, page_of(file, coverage))


# --- command -------------------------------------------------------------------------------------------


@click.command("coverage", short_help="show which parts of a behavior its tests, or recordings, exercise")
@click.argument("file", metavar="FILE", type=BEHAVIOR)
@click.argument("recordings", nargs=-1, metavar="[RECORDING]...")
@description_option()
@params_option()
@click.option("--all", "everywhere", is_flag=True, help="Also what imported files declare.")
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
@click.option(
    "--lcov",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PATH",
    help="Write the result for editors, too: obligations as branches of their lines.",
)
@click.option(
    "--html",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PATH",
    help="Write the source with what each line and condition lacks, as one page.",
)
@click.option(
    "--generate",
    "generates",
    is_flag=True,
    help="Append the missing tests to FILE, each with the mark `observed`: read what it expects, and remove "
    "the mark, or correct the behavior.",
)
@click.option(
    "--fail-under",
    type=click.FloatRange(0, 100),
    metavar="PERCENT",
    help="Exit with 1 if less of what can be covered is covered.",
)
def command(
    file: str,
    recordings: tuple[str, ...],
    everywhere: bool,
    format_: str,
    lcov: Path | None,
    html: Path | None,
    generates: bool,
    fail_under: float | None,
) -> None:
    """Count what the tests of FILE exercise or, if there are any, the RECORDINGs.

    Counted are modules (active, winning, dominated, blind), both sides of each suppressor and inhibitor, each
    condition of a predicate by masking MC/DC, limits, phases and transitions of machines, and sensors that
    were missing. What is proved never to happen is left out of 100 %.

    Exit code: 0; 1 if the file has errors, or less than --fail-under is covered; 2 if a file cannot be read.

    \b
    Example:
      colony coverage wander
      colony coverage patrol.colony --generate
      colony coverage wander run.mcap --lcov wander.info --html wander.html
    """
    from colony.text.diagnostics import DiagnosticError
    from colony.verify.coverage.measure import GoalProver, measure
    from colony.verify.coverage.obligations import plan_of
    from colony.verify.coverage.recorder import Recorder

    if generates:
        from colony.cli.verify.work import check_writable

        check_writable(file, "--generate")
    for written in (lcov, html):
        if written is not None:
            check_output(written, (file, *recordings))
    program = load_program(file)
    plan = plan_of(program, everywhere=everywhere)
    recorder = Recorder(plan)
    try:
        for recording in recordings:
            _follow(recording, plan, recorder)
        if not recordings:
            with redirect_stdout(sys.stderr):  # for prints of Python modules
                recorder.run_tests(program.tests)
    except DiagnosticError as failure:
        if failure.diagnostics[0].code[0] in "AF":
            refuse(failure.diagnostics)
        exit_with(failure.diagnostics)
    with proof_progress() as (on_progress, _):

        def on_obligation(number: int, subject: str) -> None:
            on_progress(number, len(plan.obligations), subject)

        coverage = measure(plan, recorder.seen, recorder.frames, GoalProver(plan), on_obligation)
    if generates:
        coverage = _with_generated(file, coverage, recorder.seen)
    _write_files(file, coverage, lcov, html)
    if format_ == "json":
        import json

        click.echo(json.dumps(row_of(file, coverage), indent=2))
    else:
        for line in text_of(file, coverage):
            click.echo(line)
    if fail_under is not None and coverage.percent < fail_under:
        say(f"{coverage.percent:.1f} % are less than --fail-under {fail_under:g}")
        raise click.exceptions.Exit(EXIT_ERRORS)
