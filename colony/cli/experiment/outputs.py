"""The text, pictures and pages that `colony experiment` writes."""

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
from colony.experiment.auditing import AuditedRun
from colony.experiment.conduct import Experiment
from colony.experiment.record import RunResult
from colony.experiment.studies import Study
from colony.files import read_file, reason

BEGIN, END = "<!-- {} -->", "<!-- end of {} -->"
"""The two lines of a page that enclose its tables; the rest of the page stays unchanged."""

PAGE_BYTES = 4 * 1024 * 1024
"""Size limit in bytes of a page for tables."""

_ROWS_ON_A_PAGE = 60
"""Longest list of runs whose page includes the first table, which has one row per run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentOutcome:
    """The results of an experiment, as far as it got."""

    results: tuple[Any, ...]
    audits: tuple[AuditedRun, ...]
    interrupted: bool

    @property
    def differences(self) -> tuple[AuditedRun, ...]:
        """The audited runs in which the interpreter decided otherwise."""
        return tuple(one for one in self.audits if one.difference)


def check_outputs(asked: Experiment, output: Path | None, plot: Path | None, page: Path | None) -> None:
    """Refuse outputs that cannot be written, before the work begins; exit with 2."""
    if output is not None:
        check_output(output)
    if page is not None:
        check_output(page)
        _page_without_tables(asked, page)
    if plot is not None:
        try:
            plot.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            cannot_write(plot, problem.strerror or str(problem))


def write_outputs(
    study: Study[Any],
    asked: Experiment,
    found: ExperimentOutcome,
    *,
    plot: Path | None,
    page: Path | None,
    as_json: bool,
) -> None:
    """Print the results, draw them, and insert them into a page."""
    tables = study.tables(asked.runs, found.results)
    audited = [_audit_line(found.audits)] if found.audits else []
    if as_json:
        click.echo(_json(study, asked, found))
    else:
        wanted = len(asked.runs) * len(asked.seeds)
        head = f"{asked.name}, {asked.label}: {len(found.results)} of {wanted} runs"
        click.echo("\n\n".join([head, *tables, *audited, *(one.difference for one in found.differences)]))
    if plot is not None and found.results:
        _draw(asked, found.results, plot)
    if page is not None and tables:
        shown = tables if len(asked.runs) <= _ROWS_ON_A_PAGE else tables[1:]
        _insert_tables(asked, [*shown, *audited], page)


def _audit_line(audits: Sequence[AuditedRun]) -> str:
    """Return the result of the audits in one line."""
    frames, other = sum(one.frames for one in audits), sum(bool(one.difference) for one in audits)
    agreement = f"differently in {other} of them" if other else "the same in all of them"
    return f"Audited: {len(audits)} runs, {frames:,} frames; the reference interpreter decided {agreement}."


def _json(study: Study[Any], asked: Experiment, found: ExperimentOutcome) -> str:
    return json.dumps(
        {
            "list": asked.name,
            "variant": asked.label,
            "interrupted": found.interrupted,
            "targets": [asdict(target) for target in study.targets(found.results)],
            "audits": [{**asdict(one), "key": one.key._asdict()} for one in found.audits],
            "results": [study.as_json(result) for result in found.results],
        },
        indent=2,
    )


def _draw(asked: Experiment, results: tuple[RunResult, ...], folder: Path) -> None:
    from colony.nav.maps.building import load_building
    from colony.view.path_picture import DrivenPath, draw_errors, draw_paths, encode

    building = load_building(asked.map_path)
    first = building.maps[0].name
    floors = {run.number: run.floors[0] if run.floors else first for run in asked.runs}
    goals: dict[tuple[str, str, str], list[DrivenPath]] = {}
    for r in results:
        drives = goals.setdefault((r.origin, r.goal, floors[r.key.number]), [])
        drives.append(DrivenPath(path=r.path, reached=r.reached, seed=r.key.seed))
    for (origin, goal, floor), drives in goals.items():
        name = f"{origin} to {goal}" + (f" of {floor}" if floor != first else "")
        title = f"{name}: {len(drives)} runs, {asked.label}"
        picture = draw_paths(building.map_named(floor), drives, title)
        write_whole(folder / f"{name.replace('/', '-').replace(' ', '_')}.png", encode(picture))
    errors = draw_errors([r.along_mm for r in results if r.reached], f"{asked.name}, {asked.label}")
    write_whole(folder / "errors.png", encode(errors))
    say(f"drawn in {folder}: {len(goals)} pictures of paths, and errors.png")


def _insert_tables(asked: Experiment, tables: Sequence[str], page: Path) -> None:
    """Put tables into a page, in place of its previous tables of this list and variant."""
    before, after = _page_without_tables(asked, page)
    text = "\n\n".join(tables)
    write_whole(page, f"{before}\n\n{text}\n\n{after}".encode())
    say(f"inserted the tables into {page}")


def _page_without_tables(asked: Experiment, page: Path) -> tuple[str, str]:
    """Return the parts of a page before and after the tables of a list and variant, with the marker lines.

    Exits with 2 if the page does not have these lines.
    """
    begin, end = (mark.format(f"{asked.name} {asked.label}") for mark in (BEGIN, END))
    try:
        text = read_file(page, PAGE_BYTES).decode("utf-8")
    except OSError as problem:
        cannot_write(page, reason(problem))
    except UnicodeDecodeError as problem:
        cannot_write(page, f"byte {problem.start} is not UTF-8; expected a Markdown page")
    before, marked, rest = text.partition(begin)
    _, closed, after = rest.partition(end)
    if not marked or not closed:
        say(f"{page}: error: expected the lines `{begin}` and `{end}`, between which the tables go")
        raise click.exceptions.Exit(EXIT_MISUSE)
    return before + begin, end + after
