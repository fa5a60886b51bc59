"""`colony experiment plates` and `colony experiment lights`: studies, which have lists of their own."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click

from colony.cli.experiment.outputs import put_into
from colony.cli.experiment.progress import progress
from colony.experiment.conduct import Experiment, conduct, of_experiment
from colony.experiment.parallel import Engine
from colony.experiment.results import Results
from colony.experiment.studies import Study


def carry_out_study(
    study: Study[Any],
    asked: Experiment,
    output: Path | None,
    engine: Engine,
    *,
    page: Path | None,
    as_json: bool,
) -> bool:
    """Run what is missing, say what was found, and put it into a page; gives whether it was interrupted.

    What is there counts, also where it was interrupted.

    Raises:
        NoPlan, Failure, ResultsError, WorkersLost: see `conduct`.
    """
    interrupted = False
    with Results(output, study.table) as results:
        try:
            with progress("run") as tell:
                conduct(asked, study.work, results, engine, tell=tell)
        except KeyboardInterrupt:
            interrupted = True
        found = _Found(results=of_experiment(asked, results), interrupted=interrupted)
    tables = study.tables(asked.runs, found.results)
    click.echo(_json(study, asked, found) if as_json else _text(asked, found, tables))
    if page is not None and tables:
        put_into(asked, tables, page)
    return interrupted


@dataclass(frozen=True, slots=True, kw_only=True)
class _Found:
    """What came of a study, as far as it got."""

    results: tuple[Any, ...]
    interrupted: bool


def _text(asked: Experiment, found: _Found, tables: Sequence[str]) -> str:
    wanted = len(asked.runs) * len(asked.seeds)
    return "\n\n".join([f"{asked.name}, {asked.label}: {len(found.results)} of {wanted} runs", *tables])


def _json(study: Study[Any], asked: Experiment, found: _Found) -> str:
    return json.dumps(
        {
            "list": asked.name,
            "variant": asked.label,
            "interrupted": found.interrupted,
            "targets": [asdict(target) for target in study.targets(found.results)],
            "results": [study.as_json(result) for result in found.results],
        },
        indent=2,
    )
