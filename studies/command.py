"""`python -m studies`: many simulated runs of a list of routes, and statistics of their results."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_INTERRUPTED, EXIT_MISUSE
from colony.cli.experiment.options import (
    audit_option,
    engine_of,
    engine_option,
    results_option,
    workers_option,
)
from colony.cli.outputs import map_option
from colony.cli.reporting import report, say

if TYPE_CHECKING:
    from colony.experiment.parallel import Engine
    from studies.auditing import AuditedRun
    from studies.catalog import Study
    from studies.conduct import Experiment
    from studies.outputs import ExperimentOutcome


@click.command("studies")
@click.argument("runs", metavar="LIST")
@map_option
@click.option(
    "--seeds",
    type=click.IntRange(min=1),
    metavar="N",
    help="Seeds per run. [default: 25 for `thesis`, 5 for `plates`, 2 for `lights`, else 1]",
)
@click.option("--runs", "chosen", metavar="NUMBERS", help="Only these runs of the list, such as 1-5,22.")
@click.option(
    "--pairs",
    type=click.IntRange(1, 100_000),
    metavar="N",
    help="With `random` and `floors`: the number of pairs. [default: 200 and 100]",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    help="With `random` and `floors`: the seed from which pairs are drawn.",
)
@click.option(
    "--variant",
    type=click.Choice(["ours", "thesis"]),
    default="ours",
    show_default=True,
    help="The algorithms: ours, or as printed in the thesis.",
)
@click.option(
    "--hazards/--no-hazards",
    default=True,
    show_default=True,
    help="Simulate hazards of the building (docs/hazards.md).",
)
@click.option("--no-hazard", multiple=True, metavar="NAME", help="Leave out this hazard. May be repeated.")
@click.option(
    "--no-source",
    multiple=True,
    metavar="NAME",
    help="Estimate the pose without this source: sonar, local-maps, lights, plates or markers. "
    "May be repeated.",
)
@click.option(
    "--side-camera",
    is_flag=True,
    help="Give the robot a camera that finds door plates, which correct its pose.",
)
@audit_option
@workers_option
@engine_option
@results_option
@click.option(
    "--plot",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Draw the paths into this folder.",
)
@click.option(
    "--write",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PAGE",
    help="Insert the tables into this Markdown page.",
)
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def command(
    audit: float,
    workers: int | None,
    engine: str,
    output: Path | None,
    plot: Path | None,
    write: Path | None,
    format_: str,
    **options: Any,
) -> None:
    """Simulate a list of runs, each with many seeds, and report the results.

    LIST is `thesis`, the forty published runs; `random`, random pairs of rooms on a map; `floors`, random
    pairs of rooms on different floors, connected by elevators; or the name of a CSV file with two
    columns, from and to. Three more lists are studies: `plates` measures how well door plates are found
    on the eleven published walks, `lights` how well ceiling lights are detected on the forty runs, and
    `sources` how much each source of the pose estimate contributes.

    The seed determines all randomness of a run: an experiment can be repeated bit for bit, with any number of
    workers. With --output, Ctrl-C loses no finished run.

    Exit code: 0 if the experiment was carried out, whatever its results; 1 if the reference interpreter
    decided a frame of an audited run differently; 2 for misuse; 130 after Ctrl-C.

    \b
    Example:
      python -m studies thesis --seeds 25 -o results.sqlite
      python -m studies thesis --runs 22,39 --no-hazard people --audit 1
      python -m studies thesis --seeds 1 --no-source lights --side-camera
      python -m studies random --map loop --pairs 200 --seed 1
      python -m studies floors --pairs 100
      python -m studies rounds.csv --map msu_engineering_3 --plot pictures
      python -m studies plates --seeds 10 -o plates.sqlite --write studies/plates.md
    """
    _check_map(options["map_path"])
    from colony.sim.compiling import announcing_compilation

    with announcing_compilation(say):
        from studies.outputs import check_outputs, write_outputs
        from studies.request import ExperimentRequest, experiment_of

    with _reporting_errors():
        study, experiment = experiment_of(ExperimentRequest(**options))
        _check(study, experiment, audit, plot)
        check_outputs(experiment, output, plot, write)
        outcome = _carry_out(study, experiment, output, _engine(engine, workers), audit)
        write_outputs(study, experiment, outcome, plot=plot, page=write, as_json=format_ == "json")
    if outcome.differences:
        raise click.exceptions.Exit(EXIT_ERRORS)
    if outcome.interrupted:
        raise click.exceptions.Exit(EXIT_INTERRUPTED)


def _check_map(path: str | None) -> None:
    """Refuse an invalid map before the simulator is imported, which takes long."""
    from colony.nav.maps.building import load_building
    from colony.text.diagnostics import DiagnosticError

    try:
        if path is not None:
            load_building(path)
    except DiagnosticError as failure:
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_MISUSE) from None


@contextmanager
def _reporting_errors() -> Iterator[None]:
    """Report an error that prevents the experiment, and exit."""
    from colony.experiment.parallel import WorkersLostError
    from colony.experiment.results import ResultsError
    from colony.nav.plan.route import NoPlanError
    from colony.text.diagnostics import DiagnosticError
    from studies.lists import RunListError
    from studies.request import MisuseError

    try:
        yield
    except DiagnosticError as failure:
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    except (RunListError, NoPlanError, ResultsError, WorkersLostError, MisuseError) as problem:
        say(f"error: {problem}")
        raise click.exceptions.Exit(EXIT_MISUSE) from None


def _check(study: Study[Any], experiment: Experiment, audit: float, plot: Path | None) -> None:
    """Refuse impossible drawings and audits."""
    from studies.request import MisuseError

    if study.has_own_variant and (plot is not None or audit or experiment.variant != "ours"):
        raise MisuseError(f"`{study.name}` has its own variant; leave out --plot, --audit and --variant")
    for run in experiment.runs if plot is not None else ():
        if run.has_ride:
            alternative = f"`colony run ... --from {run.origin} --to {run.goal}` draws each floor"
            raise MisuseError(f"--plot cannot draw elevator rides; run {run.number} has one: {alternative}")


def _engine(text: str, workers: int | None) -> Engine:
    from studies.request import MisuseError

    try:
        return engine_of(text, workers)
    except ValueError as problem:
        raise MisuseError(f"unknown engine {problem}") from None


def _carry_out(
    study: Study[Any], experiment: Experiment, output: Path | None, engine: Engine, fraction: float
) -> ExperimentOutcome:
    """Run the missing runs and the audits; return the results, even if interrupted."""
    from colony.cli.progress import experiment_progress
    from colony.experiment.results import Results
    from studies.conduct import conduct, conduct_audit, results_of
    from studies.outputs import ExperimentOutcome, describe_audit, describe_run, is_different, is_failed

    audits: tuple[AuditedRun, ...] = ()
    interrupted = False
    with Results(output, study.table) as results:
        try:
            with experiment_progress("run", is_failed, describe_run) as on_progress:
                conduct(experiment, study.work, results, engine, on_progress=on_progress)
            if fraction > 0.0:
                with experiment_progress("audited", is_different, describe_audit) as on_audit_progress:
                    audits = conduct_audit(experiment, engine, fraction, on_progress=on_audit_progress)
        except KeyboardInterrupt:
            interrupted = True
        return ExperimentOutcome(
            results=results_of(experiment, results), audits=audits, interrupted=interrupted
        )
