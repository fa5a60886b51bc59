"""`colony experiment`: run a list of runs many times over, in simulation, and say how they went."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_INTERRUPTED, EXIT_MISUSE
from colony.cli.reporting import report, say

if TYPE_CHECKING:
    from colony.cli.experiment_outputs import Found
    from colony.experiment.auditing import AuditedRun
    from colony.experiment.conduct import Experiment
    from colony.experiment.lists import ListedRun
    from colony.experiment.parallel import Engine
    from colony.sim.hazards import Hazards

RANDOM = "random"
THESIS = "thesis"
THESIS_SEEDS = 25


class _Misuse(Exception):
    """What was asked for makes no sense."""


@click.command("experiment", short_help="run a list of runs many times over, and count")
@click.argument("runs", metavar="LIST")
@click.option("--map", "map_path", type=click.Path(path_type=Path), metavar="MAP", help="The building.")
@click.option(
    "--seeds", type=click.IntRange(min=1), metavar="N", help="Seeds a run. [default: 25, of other lists 1]"
)
@click.option("--runs", "chosen", metavar="NUMBERS", help="Only these runs of the list, as 1-5,22.")
@click.option(
    "--pairs", type=click.IntRange(1, 100_000), default=200, show_default=True, help="With `random`."
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=1, show_default=True, help="With `random`: of the pairs."
)
@click.option("--variant", type=click.Choice(["ours", "thesis"]), default="ours", show_default=True)
@click.option(
    "--hazards/--no-hazards", default=True, show_default=True, help="What goes wrong in a building."
)
@click.option(
    "--no-hazard", "without", multiple=True, metavar="NAME", help="All but this one. May be repeated."
)
@click.option(
    "--audit",
    type=click.FloatRange(0.0, 1.0),
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
    runs: str,
    map_path: Path | None,
    seeds: int | None,
    chosen: str | None,
    pairs: int,
    seed: int,
    variant: str,
    hazards: bool,
    without: tuple[str, ...],
    audit: float,
    workers: int | None,
    engine: str,
    output: Path | None,
    plot: Path | None,
    write: Path | None,
    format_: str,
) -> None:
    """Run a list of runs in simulation, each with many seeds, and say how they went.

    LIST is `thesis`, the forty published runs; `random`, random pairs of rooms of a map; or a CSV file with
    two columns, from and to. A seed decides all chance in a run, so that an experiment can be repeated bit
    for bit, with any number of workers. Ctrl-C loses no run that was finished where there is --output.

    Exit code 0 where the experiment was carried out, whatever came of it; 1 where an audit found a frame that
    the reference interpreter decides otherwise; 2 for misuse; 130 after Ctrl-C.

    \b
    Example:
      colony experiment thesis --seeds 25 -o results.sqlite
      colony experiment thesis --runs 22,39 --no-hazard people --audit 1
      colony experiment random --map maps/loop.stickrep --pairs 200 --seed 1
      colony experiment rounds.csv --map maps/msu_engineering_3.stickrep --plot pictures
    """
    from colony.cli.experiment_outputs import check_outputs, put_out
    from colony.diagnostics import Failure
    from colony.experiment.lists import ListProblem
    from colony.experiment.parallel import WorkersLost
    from colony.experiment.results import ResultsError
    from colony.nav.route import NoPlan

    try:
        listed, name, place = _listed(runs, map_path, pairs, seed)
        asked = _experiment(listed, name, place, seeds, chosen, variant, _hazards(hazards, without))
        check_outputs(asked, output, plot, write)
        found = _carry_out(asked, output, _engine(engine, workers), audit)
        put_out(asked, found, plot=plot, page=write, as_json=format_ == "json")
    except Failure as failure:
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    except (ListProblem, NoPlan, ResultsError, WorkersLost, _Misuse) as problem:
        say(f"error: {problem}")
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    if found.differences:
        raise click.exceptions.Exit(EXIT_ERRORS)
    if found.interrupted:
        raise click.exceptions.Exit(EXIT_INTERRUPTED)


def _listed(
    runs: str, map_path: Path | None, pairs: int, seed: int
) -> tuple[tuple[ListedRun, ...], str, Path]:
    """The runs, the name of their list, and the map."""
    from hashlib import sha256

    from colony.experiment.lists import PUBLISHED_MAP, own_list, published_list, random_list
    from colony.nav.stickrep_reader import load_map

    if runs == THESIS:
        if map_path is not None:
            raise _Misuse("the published runs have a map of their own; leave out --map")
        return published_list(), THESIS, PUBLISHED_MAP
    if map_path is None:
        raise _Misuse("which building? give --map MAP, such as maps/loop.stickrep")
    floor = load_map(map_path)
    if runs == RANDOM:
        return random_list(floor, pairs, seed), f"{RANDOM} {pairs} pairs, seed {seed}, {floor.name}", map_path
    path = Path(runs)
    if path.suffix.lower() != ".csv":
        raise _Misuse(f"there is no list `{runs}`; expected {THESIS}, {RANDOM} or a file that ends in .csv")
    listed = own_list(path, floor)
    digest = sha256(repr([(run.origin, run.goal) for run in listed]).encode()).hexdigest()[:8]
    return listed, f"{path.stem} {digest}, {floor.name}", map_path


def _experiment(
    listed: tuple[ListedRun, ...],
    name: str,
    place: Path,
    seeds: int | None,
    numbers: str | None,
    variant: str,
    hazards: Hazards,
) -> Experiment:
    from colony.experiment.conduct import Experiment
    from colony.experiment.lists import chosen
    from colony.experiment.variants import VARIANTS

    count = seeds or (THESIS_SEEDS if name == THESIS else 1)
    return Experiment(
        name=name,
        map_path=place.resolve(),
        runs=listed if numbers is None else chosen(listed, numbers),
        seeds=tuple(range(1, count + 1)),
        variant=VARIANTS[variant].name,
        hazards=hazards,
    )


def _hazards(on: bool, without: tuple[str, ...]) -> Hazards:
    from colony.experiment.conduct import HAZARD_NAMES
    from colony.sim.hazards import Hazards

    for name in without:
        if name not in HAZARD_NAMES:
            raise _Misuse(f"there is no hazard `{name}`; expected {', '.join(HAZARD_NAMES)}")
    return Hazards().without(*(HAZARD_NAMES[name] for name in without)) if on else Hazards.none()


def _engine(text: str, workers: int | None) -> Engine:
    from colony.experiment.dask_engine import DaskEngine
    from colony.experiment.parallel import PoolEngine, SerialEngine

    name, _, address = text.partition("=")
    match name:
        case "pool" if not address:
            return PoolEngine(workers)
        case "serial" if not address:
            return SerialEngine()
        case "dask":
            return DaskEngine(address, workers)
        case _:
            raise _Misuse(f"there is no engine `{text}`; expected pool, serial, dask or dask=tcp://HOST:PORT")


def _carry_out(asked: Experiment, output: Path | None, engine: Engine, part: float) -> Found:
    """Run what is missing and audit what is to be; what is there counts, also where it was interrupted."""
    from colony.cli.experiment_outputs import Found
    from colony.cli.experiment_progress import progress
    from colony.experiment.conduct import conduct, conduct_audit, of_experiment
    from colony.experiment.results import Results

    audits: tuple[AuditedRun, ...] = ()
    interrupted = False
    with Results(output) as results:
        try:
            with progress("run") as tell:
                conduct(asked, results, engine, tell=tell)
            if part > 0.0:
                with progress("audited") as tell_audit:
                    audits = conduct_audit(asked, engine, part, tell=tell_audit)
        except KeyboardInterrupt:
            interrupted = True
        return Found(results=of_experiment(asked, results), audits=audits, interrupted=interrupted)
