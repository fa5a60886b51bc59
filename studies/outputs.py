"""The text, pictures and pages that `python -m studies` writes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click

from colony.cli.exit_codes import EXIT_MISUSE
from colony.cli.outputs import cannot_write, check_output, write_whole
from colony.cli.reporting import say
from colony.files import read_file, reason
from studies.auditing import AuditedRun
from studies.catalog import Study
from studies.conduct import Experiment
from studies.record import RunResult

BEGIN, END = "<!-- {} -->", "<!-- end of {} -->"
"""The marker lines that enclose the tables of a page; the rest of the page stays unchanged."""

PAGE_BYTES = 4 * 1024 * 1024
"""Size limit in bytes of a page for tables."""

_MAX_ROWS_ON_A_PAGE = 60
"""Maximum number of runs for which a page includes the first table, which has one row per run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentOutcome:
    """The results of an experiment; incomplete if it was interrupted."""

    results: tuple[Any, ...]
    audits: tuple[AuditedRun, ...]
    interrupted: bool

    @property
    def differences(self) -> tuple[AuditedRun, ...]:
        """The audited runs in which the interpreter decided differently."""
        return tuple(run for run in self.audits if run.difference)


def check_outputs(experiment: Experiment, output: Path | None, plot: Path | None, page: Path | None) -> None:
    """Refuse outputs that cannot be written, before the work begins; exit with 2."""
    if output is not None:
        check_output(output)
    if page is not None:
        check_output(page)
        _page_without_tables(experiment, page)
    if plot is not None:
        try:
            plot.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            cannot_write(plot, problem.strerror or str(problem))


def write_outputs(
    study: Study[Any],
    experiment: Experiment,
    outcome: ExperimentOutcome,
    *,
    plot: Path | None,
    page: Path | None,
    as_json: bool,
) -> None:
    """Print the results, draw them, and insert them into a page."""
    tables = study.tables(experiment.runs, outcome.results)
    audit_lines = [_audit_line(outcome.audits)] if outcome.audits else []
    if as_json:
        click.echo(_json(study, experiment, outcome))
    else:
        total = len(experiment.runs) * len(experiment.seeds)
        head = f"{experiment.name}, {experiment.label}: {len(outcome.results)} of {total} runs"
        click.echo(
            "\n\n".join([head, *tables, *audit_lines, *(run.difference for run in outcome.differences)])
        )
    if plot is not None and outcome.results:
        _draw(experiment, outcome.results, plot)
    if page is not None and tables:
        shown = tables if len(experiment.runs) <= _MAX_ROWS_ON_A_PAGE else tables[1:]
        _insert_tables(experiment, [*shown, *audit_lines], page)


def _audit_line(audits: Sequence[AuditedRun]) -> str:
    """Return the result of the audits in one line."""
    frames, differing = sum(run.frames for run in audits), sum(bool(run.difference) for run in audits)
    agreement = f"differently in {differing} of them" if differing else "the same in all of them"
    return f"Audited: {len(audits)} runs, {frames:,} frames; the reference interpreter decided {agreement}."


def _json(study: Study[Any], experiment: Experiment, outcome: ExperimentOutcome) -> str:
    return json.dumps(
        {
            "list": experiment.name,
            "variant": experiment.label,
            "interrupted": outcome.interrupted,
            "targets": [asdict(target) for target in study.targets(outcome.results)],
            "audits": [{**asdict(run), "key": run.key._asdict()} for run in outcome.audits],
            "results": [study.as_json(result) for result in outcome.results],
        },
        indent=2,
    )


def _draw(experiment: Experiment, results: tuple[RunResult, ...], folder: Path) -> None:
    from colony.nav.maps.building import load_building
    from studies.path_picture import DrivenPath, draw_errors, draw_paths, encode

    building = load_building(experiment.map_path)
    first = building.maps[0].name
    floors = {run.number: run.floors[0] if run.floors else first for run in experiment.runs}
    goals: dict[tuple[str, str, str], list[DrivenPath]] = {}
    for r in results:
        paths = goals.setdefault((r.origin, r.goal, floors[r.key.number]), [])
        paths.append(DrivenPath(path=r.path, reached=r.reached, seed=r.key.seed))
    for (origin, goal, floor), paths in goals.items():
        name = f"{origin} to {goal}" + (f" of {floor}" if floor != first else "")
        title = f"{name}: {len(paths)} runs, {experiment.label}"
        picture = draw_paths(building.map_named(floor), paths, title)
        write_whole(folder / f"{name.replace('/', '-').replace(' ', '_')}.png", encode(picture))
    overshoots = [r.overshoot_mm for r in results if r.reached]
    errors = draw_errors(overshoots, f"{experiment.name}, {experiment.label}")
    write_whole(folder / "errors.png", encode(errors))
    say(f"drawn in {folder}: {len(goals)} pictures of paths, and errors.png")


def _insert_tables(experiment: Experiment, tables: Sequence[str], page: Path) -> None:
    """Put tables into a page, in place of its previous tables of this list and variant."""
    before, after = _page_without_tables(experiment, page)
    text = "\n\n".join(tables)
    write_whole(page, f"{before}\n\n{text}\n\n{after}".encode())
    say(f"inserted the tables into {page}")


def _page_without_tables(experiment: Experiment, page: Path) -> tuple[str, str]:
    """Return the parts of a page before and after the tables of a list and variant, with the marker lines.

    Exits with 2 if the page does not have these lines.
    """
    begin, end = (mark.format(f"{experiment.name} {experiment.label}") for mark in (BEGIN, END))
    try:
        text = read_file(page, PAGE_BYTES).decode("utf-8")
    except OSError as problem:
        cannot_write(page, reason(problem))
    except UnicodeDecodeError as problem:
        cannot_write(page, f"byte {problem.start} is not UTF-8; expected a Markdown page")
    before, found_begin, rest = text.partition(begin)
    _, found_end, after = rest.partition(end)
    if not found_begin or not found_end:
        say(f"{page}: error: expected the lines `{begin}` and `{end}`, between which the tables go")
        raise click.exceptions.Exit(EXIT_MISUSE)
    return before + begin, end + after


def is_failed(result: Any) -> bool:
    """Return True if a run failed."""
    return bool(result.failure)


def describe_run(result: Any) -> str:
    """Return a short description of the result of a run."""
    off = f", {result.goal_error_mm / 1000:.2f} m off" if isinstance(result, RunResult) else ""
    return f"run {result.key.number}, seed {result.key.seed}, {result.failure or 'reached'}{off}"


def is_different(run: AuditedRun) -> bool:
    """Return True if an audit found a difference."""
    return bool(run.difference)


def describe_audit(run: AuditedRun) -> str:
    """Return a short description of an audited run."""
    return f"run {run.key.number}, seed {run.key.seed}, {run.frames} frames"
