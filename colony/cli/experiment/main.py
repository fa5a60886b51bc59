"""`colony experiment`: run a list of runs many times over, in simulation, and say how they went."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_INTERRUPTED, EXIT_MISUSE
from colony.cli.reporting import report, say

if TYPE_CHECKING:
    from colony.cli.experiment.outputs import Found
    from colony.experiment.auditing import AuditedRun
    from colony.experiment.conduct import Experiment
    from colony.experiment.lists import ListedRun
    from colony.experiment.parallel import Engine
    from colony.sim.hazards.hazards import Hazards

RANDOM = "random"
FLOORS = "floors"
PAIRS = {RANDOM: 200, FLOORS: 100}
THESIS = "thesis"
THESIS_SEEDS = 25


class _Misuse(Exception):
    """What was asked for makes no sense."""


def _part(context: click.Context, option: click.Parameter, value: float) -> float:
    """0 to 1; a range of click lets nan through."""
    if not 0.0 <= value <= 1.0:
        raise click.BadParameter(f"`{value:g}`; expected a part of the runs, from 0 to 1")
    return value


@click.command("experiment", short_help="run a list of runs many times over, and count")
@click.argument("runs", metavar="LIST")
@click.option("--map", "map_path", type=click.Path(path_type=Path), metavar="MAP", help="The building.")
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
    help=f"With `random` and `floors`. [default: {PAIRS[RANDOM]}, {PAIRS[FLOORS]}]",
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
@click.option(
    "--no-hazard", "without", multiple=True, metavar="NAME", help="All but this one. May be repeated."
)
@click.option(
    "--no-source",
    "no_sources",
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
    runs: str,
    map_path: Path | None,
    seeds: int | None,
    chosen: str | None,
    pairs: int | None,
    seed: int,
    variant: str,
    hazards: bool,
    without: tuple[str, ...],
    no_sources: tuple[str, ...],
    side_camera: bool,
    audit: float,
    workers: int | None,
    engine: str,
    output: Path | None,
    plot: Path | None,
    write: Path | None,
    format_: str,
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
      colony experiment random --map maps/loop.stickrep --pairs 200 --seed 1
      colony experiment floors --pairs 100
      colony experiment rounds.csv --map maps/msu_engineering_3.stickrep --plot pictures
      colony experiment plates --seeds 10 -o plates.sqlite --write docs/plates.md
    """
    from colony.cli.experiment.outputs import check_outputs, put_out
    from colony.cli.experiment.studies import carry_out_study
    from colony.experiment.lists import ListProblem
    from colony.experiment.parallel import WorkersLost
    from colony.experiment.results import ResultsError
    from colony.experiment.studies import STUDIES
    from colony.nav.plan.route import NoPlan
    from colony.text.diagnostics import Failure

    try:
        listed, name, place = _listed(runs, map_path, pairs, seed)
        asked = _experiment(listed, name, place, seeds, chosen, variant, _hazards(hazards, without))
        asked = _with_sources(asked, no_sources, side_camera)
        if name in STUDIES and (plot is not None or audit or variant != "ours"):
            raise _Misuse(f"`{name}` has a variant of its own; leave out --plot, --audit and --variant")
        if plot is not None:
            _check_plot(asked)
        check_outputs(asked, output, plot, write)
        if name in STUDIES:
            study, work = STUDIES[name], _engine(engine, workers)
            if carry_out_study(study, asked, output, work, page=write, as_json=format_ == "json"):
                raise click.exceptions.Exit(EXIT_INTERRUPTED)
            return
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
    runs: str, map_path: Path | None, pairs: int | None, seed: int
) -> tuple[tuple[ListedRun, ...], str, Path]:
    """The runs, the name of their list, and the map."""
    from hashlib import sha256

    from colony.experiment.lists import PUBLISHED_MAP, floors_list, own_list, published_list, random_list
    from colony.experiment.studies import STUDIES
    from colony.nav.maps.building import load_building

    if pairs is not None and runs not in PAIRS:
        raise _Misuse(f"--pairs goes with {' and '.join(f'`{name}`' for name in PAIRS)}, not with `{runs}`")
    if runs == THESIS or runs in STUDIES:
        if map_path is not None:
            raise _Misuse("the published runs have a map of their own; leave out --map")
        listed = STUDIES[runs].runs() if runs in STUDIES else published_list()
        return listed, runs, PUBLISHED_MAP
    path = Path(runs)
    if runs not in PAIRS and path.suffix.lower() != ".csv":
        known = ", ".join([THESIS, *PAIRS, *STUDIES])
        raise _Misuse(f"there is no list `{runs}`; expected {known} or a file that ends in .csv")
    if map_path is None and runs != FLOORS:
        raise _Misuse("which building? give --map MAP, such as maps/loop.stickrep")
    map_path = map_path or PUBLISHED_MAP
    building = load_building(map_path)
    floor = building.maps[0]
    if runs in PAIRS:
        count = pairs or PAIRS[runs]
        listed = random_list(floor, count, seed) if runs == RANDOM else floors_list(building, count, seed)
        return listed, f"{runs} {count} pairs, seed {seed}, {floor.name}", map_path
    listed = own_list(path, building)
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
    from colony.experiment.studies import STUDIES
    from colony.robots.variants import CEILING_CAMERA, FRONT_CAMERA, VARIANTS

    runs = listed if numbers is None else chosen(listed, numbers)
    rides = any(run.rides for run in runs)  # elevators have markers for a camera that looks ahead
    count = seeds or (STUDIES[name].seeds if name in STUDIES else THESIS_SEEDS if name == THESIS else 1)
    return Experiment(
        name=name,
        map_path=place.resolve(),
        runs=runs,
        seeds=tuple(range(1, count + 1)),
        variant=VARIANTS[variant].name,
        hazards=hazards,
        cameras=frozenset({CEILING_CAMERA, *([FRONT_CAMERA] if rides else [])}),
    )


def _check_plot(asked: Experiment) -> None:
    for run in asked.runs:
        if run.rides:
            one = f"`colony run ... --from {run.origin} --to {run.goal}` draws each floor"
            raise _Misuse(f"--plot is for ways on one floor; run {run.number} takes an elevator: {one}")


def _with_sources(asked: Experiment, without: tuple[str, ...], side_camera: bool) -> Experiment:
    from dataclasses import replace

    from colony.experiment.studies import STUDIES
    from colony.nav.pose.tracker import Source
    from colony.robots.variants import SIDE_CAMERA

    if not without and not side_camera:
        return asked
    if asked.variant != "ours" or asked.name in STUDIES:
        raise _Misuse(
            f"--no-source and --side-camera are for the variant `ours`, and not for {', '.join(STUDIES)}"
        )
    names = {source.value: source for source in Source}
    for name in without:
        if name not in names:
            raise _Misuse(f"there is no source `{name}`; expected {', '.join(names)}")
    sources = asked.sources - {names[name] for name in without}
    cameras = asked.cameras | {SIDE_CAMERA} if side_camera else asked.cameras
    return replace(asked, sources=sources, cameras=cameras)


def _hazards(on: bool, without: tuple[str, ...]) -> Hazards:
    from colony.experiment.conduct import HAZARD_NAMES
    from colony.sim.hazards.hazards import Hazards

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
    from colony.cli.experiment.outputs import Found
    from colony.cli.experiment.progress import progress
    from colony.experiment.conduct import conduct, conduct_audit, of_experiment
    from colony.experiment.results import RUN_TABLE, Results
    from colony.experiment.runs import run

    audits: tuple[AuditedRun, ...] = ()
    interrupted = False
    with Results(output, RUN_TABLE) as results:
        try:
            with progress("run") as tell:
                conduct(asked, run, results, engine, tell=tell)
            if part > 0.0:
                with progress("audited") as tell_audit:
                    audits = conduct_audit(asked, engine, part, tell=tell_audit)
        except KeyboardInterrupt:
            interrupted = True
        return Found(results=of_experiment(asked, results), audits=audits, interrupted=interrupted)
