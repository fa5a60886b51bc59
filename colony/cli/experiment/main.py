"""`colony experiment`: run a list of runs many times in simulation, and report the results."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_INTERRUPTED, EXIT_MISUSE
from colony.cli.reporting import report, say
from colony.cli.shipped_files import map_option
from colony.extras import expect_extras

if TYPE_CHECKING:
    from colony.cli.experiment.outputs import Found
    from colony.experiment.auditing import AuditedRun
    from colony.experiment.conduct import Experiment
    from colony.experiment.parallel import Engine
    from colony.experiment.studies import Study


def _part(context: click.Context, option: click.Parameter, value: float) -> float:
    """Return a fraction from 0 to 1; a click range would let NaN through."""
    if not 0.0 <= value <= 1.0:
        raise click.BadParameter(f"`{value:g}`; expected a part of the runs, from 0 to 1")
    return value


@click.command("experiment", short_help="run a list of runs many times over, and count")
@click.argument("runs", metavar="LIST")
@map_option
@click.option(
    "--seeds",
    type=click.IntRange(min=1),
    metavar="N",
    help="Seeds a run. [default: 25 of `thesis`, 5 of `plates`, 2 of `lights`, else 1]",
)
@click.option("--runs", "chosen", metavar="NUMBERS", help="Only these runs of the list, as 1-5,22.")
@click.option(
    "--pairs",
    type=click.IntRange(1, 100_000),
    metavar="N",
    help="With `random` and `floors`. [default: 200, 100]",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    help="With `random` and `floors`: of the pairs.",
)
@click.option("--variant", type=click.Choice(["ours", "thesis"]), default="ours", show_default=True)
@click.option(
    "--hazards/--no-hazards", default=True, show_default=True, help="What goes wrong in a building."
)
@click.option("--no-hazard", multiple=True, metavar="NAME", help="All but this one. May be repeated.")
@click.option(
    "--no-source",
    multiple=True,
    metavar="NAME",
    help="Estimate the pose without it: sonar, local-maps, lights, plates or markers. May be repeated.",
)
@click.option(
    "--side-camera", is_flag=True, help="The robot looks for door plates, and is corrected by them."
)
@click.option(
    "--audit",
    type=float,
    callback=_part,
    default=0.0,
    metavar="PART",
    help="Hold this part of the runs, 0 to 1, against the reference interpreter.",
)
@click.option("--workers", type=click.IntRange(min=1), help="Processes. [default: one a core]")
@click.option(
    "--engine",
    default="pool",
    show_default=True,
    metavar="WHERE",
    help="pool, serial, dask or dask=tcp://HOST:PORT.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PATH",
    help="Keep the results there (SQLite); what is there already is not run again.",
)
@click.option(
    "--plot", type=click.Path(file_okay=False, path_type=Path), metavar="DIR", help="Draw the paths there."
)
@click.option(
    "--write", type=click.Path(dir_okay=False, path_type=Path), metavar="PAGE", help="Put the tables there."
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
    **asked_for: Any,
) -> None:
    """Run a list of runs in simulation, each with many seeds, and say how they went.

    LIST is `thesis`, the forty published runs; `random`, random pairs of rooms of a map; `floors`, random
    pairs of rooms on different floors, with elevators between; or a CSV file with two columns, from and to.
    `plates` counts what finders make of door plates on the eleven published walks past them, and `lights` how
    well ceiling lights are detected on the forty runs. `sources` tells what each source of the pose is worth.

    A seed decides all chance in a run, so that an experiment can be repeated bit for bit, with any number of
    workers. Ctrl-C loses no run that was finished where there is --output.

    Exit code 0 where the experiment was carried out, whatever came of it; 1 where an audit found a frame that
    the reference interpreter decides otherwise; 2 for misuse; 130 after Ctrl-C.

    \b
    Example:
      colony experiment thesis --seeds 25 -o results.sqlite
      colony experiment thesis --runs 22,39 --no-hazard people --audit 1
      colony experiment thesis --seeds 1 --no-source lights --side-camera
      colony experiment random --map loop --pairs 200 --seed 1
      colony experiment floors --pairs 100
      colony experiment rounds.csv --map msu_engineering_3 --plot pictures
      colony experiment plates --seeds 10 -o plates.sqlite --write docs/plates.md
    """
    expect_extras("sim", "vision")
    _check_map(asked_for["map_path"])
    from colony.sim.compiling import told_when_compiling

    with told_when_compiling(say):
        from colony.cli.experiment.outputs import check_outputs, put_out
        from colony.experiment.request import ExperimentRequest, experiment_of

    with _problems_told():
        study, asked = experiment_of(ExperimentRequest(**asked_for))
        _check(study, asked, audit, plot)
        check_outputs(asked, output, plot, write)
        found = _carry_out(study, asked, output, _engine(engine, workers), audit)
        put_out(study, asked, found, plot=plot, page=write, as_json=format_ == "json")
    if found.differences:
        raise click.exceptions.Exit(EXIT_ERRORS)
    if found.interrupted:
        raise click.exceptions.Exit(EXIT_INTERRUPTED)


def _check_map(path: str | None) -> None:
    """Refuse a bad map before the simulator is imported, which takes long."""
    from colony.nav.maps.building import load_building
    from colony.text.diagnostics import DiagnosticError

    try:
        if path is not None:
            load_building(path)
    except DiagnosticError as failure:
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_MISUSE) from None


@contextmanager
def _problems_told() -> Iterator[None]:
    """Report an error that prevents the experiment, and exit."""
    from colony.experiment.lists import RunListError
    from colony.experiment.parallel import WorkersLostError
    from colony.experiment.request import MisuseError
    from colony.experiment.results import ResultsError
    from colony.nav.plan.route import NoPlanError
    from colony.text.diagnostics import DiagnosticError

    try:
        yield
    except DiagnosticError as failure:
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    except (RunListError, NoPlanError, ResultsError, WorkersLostError, MisuseError) as problem:
        say(f"error: {problem}")
        raise click.exceptions.Exit(EXIT_MISUSE) from None


def _check(study: Study[Any], asked: Experiment, audit: float, plot: Path | None) -> None:
    """Refuse impossible drawings and audits."""
    from colony.experiment.request import MisuseError

    if study.has_own_variant and (plot is not None or audit or asked.variant != "ours"):
        raise MisuseError(f"`{study.name}` has a variant of its own; leave out --plot, --audit and --variant")
    for run in asked.runs if plot is not None else ():
        if run.rides:
            one = f"`colony run ... --from {run.origin} --to {run.goal}` draws each floor"
            raise MisuseError(f"--plot is for ways on one floor; run {run.number} takes an elevator: {one}")


def _engine(text: str, workers: int | None) -> Engine:
    from colony.experiment.dask_engine import DaskEngine
    from colony.experiment.parallel import PoolEngine, SerialEngine
    from colony.experiment.request import MisuseError

    name, _, address = text.partition("=")
    match name:
        case "pool" if not address:
            return PoolEngine(workers)
        case "serial" if not address:
            return SerialEngine()
        case "dask":
            return DaskEngine(address, workers)
        case _:
            raise MisuseError(
                f"there is no engine `{text}`; expected pool, serial, dask or dask=tcp://HOST:PORT"
            )


def _carry_out(
    study: Study[Any], asked: Experiment, output: Path | None, engine: Engine, part: float
) -> Found:
    """Run the missing runs and the audits; return the results, even if interrupted."""
    from colony.cli.experiment.outputs import Found
    from colony.cli.experiment.progress import progress
    from colony.experiment.conduct import conduct, conduct_audit, of_experiment
    from colony.experiment.results import Results

    audits: tuple[AuditedRun, ...] = ()
    interrupted = False
    with Results(output, study.table) as results:
        try:
            with progress("run") as tell:
                conduct(asked, study.work, results, engine, tell=tell)
            if part > 0.0:
                with progress("audited") as tell_audit:
                    audits = conduct_audit(asked, engine, part, tell=tell_audit)
        except KeyboardInterrupt:
            interrupted = True
        return Found(results=of_experiment(asked, results), audits=audits, interrupted=interrupted)
