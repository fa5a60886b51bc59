"""`colony experiment`: many simulated runs of a behavior, and statistics of their results."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from importlib import import_module
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
from colony.cli.outputs import BEHAVIOR, check_output, map_option, write_whole
from colony.cli.params_choice import chosen_params, params_option
from colony.cli.reporting import say
from colony.cli.robot_choice import chosen_robot, description_option
from colony.cli.run.options import (
    DURATION,
    MAX_MOVERS,
    OptionError,
    behavior_argument,
    duration_ns,
    duration_option,
    expect_both_ends,
    format_option,
    goal_option,
    origin_option,
    run_spec,
    scenario_option,
    settings_option,
    start_option,
)
from colony.extras import expect_extras
from colony.runs.spec import MisuseError

if TYPE_CHECKING:
    from colony.experiment.design import Experiment, ProgramChoice, SweptRange, Trial
    from colony.experiment.parallel import Engine
    from colony.experiment.trial import TrialResult
    from colony.nav.maps.world_map import WorldMap


MAX_RUNS = 1_000_000
"""The largest number of a run."""


@click.command("experiment", short_help="simulate many runs of a behavior, and report statistics")
@behavior_argument
@description_option()
@map_option
@click.option(
    "--runs", type=click.IntRange(1, MAX_RUNS), default=100, show_default=True, help="The number of runs."
)
@duration_option(f"{DURATION}, with --to until the robot has arrived")
@click.option(
    "--seed",
    type=click.IntRange(0, 10**18),  # seeds of runs are integers of SQLite
    default=1,
    show_default=True,
    help="The seed of the first run; each further run has the next one.",
)
@click.option(
    "--vary",
    type=click.Choice(["start"]),
    multiple=True,
    help="Draw this for each run: the place and heading where the robot starts.",
)
@start_option
@click.option(
    "--movers",
    metavar="N|A..B",
    default="0",
    help="Simulate N people who walk around, or a number from A to B that is drawn for each run.",
)
@click.option(
    "--param",
    "ranges",
    multiple=True,
    metavar="NAME=LOW..HIGH",
    help="Draw a param of the behavior from a range for each run: avoid.clearance=0.6..1.4m. Whole numbers "
    "without a unit give whole numbers. May be repeated.",
)
@params_option()
@settings_option
@scenario_option
@origin_option
@goal_option
@click.option("--hazards", is_flag=True, help="With --to: simulate hazards, drawn for each run.")
@click.option(
    "--versus",
    metavar="FILE",
    type=BEHAVIOR,
    help="Run this behavior with the same inputs, too, and report the differences run by run.",
)
@click.option(
    "--replay",
    type=click.IntRange(1, MAX_RUNS),
    metavar="N",
    help="Only record run number N into run-N.mcap, for `colony watch` and `colony explain`.",
)
@audit_option
@workers_option
@engine_option
@results_option
@click.option("--picture", metavar="PATH", help="Draw all paths and contacts over the map, as PNG or SVG.")
@format_option
def command(
    workers: int | None,
    engine: str,
    output: Path | None,
    picture: str | None,
    replay: int | None,
    format_: str,
    **options: Any,
) -> None:
    """Run a behavior many times in a simulated world, and report how often it fails, with confidence.

    FILE is a behavior, or the name of one that comes with colony. Each run has a seed of its own, which
    determines the noise of its sensors and everything that varies: an experiment can be repeated bit for bit,
    with any number of workers. The report has the contacts, the distance, how long each module commanded,
    what limits cut, the broken contracts, the frames without a value of a needed sensor ("blind"), and the
    runs in which the robot was stuck: 30 s without leaving a circle of half a meter. Intervals are of 95 %.

    With --param the report shows how a param changes these figures, in four parts of its range. With
    --versus a second behavior gets the same inputs (docs/experiments.md).

    With --output, Ctrl-C loses no finished run: the same command goes on, also with more --runs.

    Exit code: 0 if no contract was broken; 1 if one was, or the reference interpreter decided a frame of an
    audited run differently; 2 for misuse; 130 after Ctrl-C.

    \b
    Example:
      colony experiment wander --map loop --runs 200 --vary start
      colony experiment wander --robot amr --map office --runs 1000 --vary start --movers 0..5 -o amr.sqlite
      colony experiment wander --map loop --vary start --param avoid.clearance=0.6..1.4m --picture runs.png
      colony experiment wander --map loop --vary start --versus mine.colony
      colony experiment wander --map loop --vary start --replay 17
      colony experiment navigator --map loop --from 201 --to 216 --hazards --runs 50
    """
    expect_extras("sim", *(["vision"] if options["goal"] is not None else []))
    with _reporting_errors():
        chosen_engine = _engine(engine, workers)
        floor = _floor(options["map_path"])
        experiment = _experiment(options, floor)
        if output is not None:
            check_output(output, [program.file for program in experiment.programs])
        if picture is not None:
            _check_picture(picture, floor)
        from colony.sim.compiling import announcing_compilation

        with announcing_compilation(say):
            import_module("colony.experiment.trial")  # with the simulator
        from colony.body.model import radius_mm
        from colony.experiment.design import compiled_of

        radius = radius_mm(compiled_of(experiment.programs[0]).described.body)
        if replay is not None:
            _replay(experiment.trials(floor, radius, [replay]), replay)
            return
        trials = experiment.trials(floor, radius, range(1, experiment.runs + 1))
        results, interrupted = _carry_out(experiment, trials, output, chosen_engine)
    _print(experiment, results, interrupted=interrupted, as_json=format_ == "json")
    if picture is not None and results:
        _draw(floor, results, picture)
    _exit(results, interrupted=interrupted)


def _engine(text: str, workers: int | None) -> Engine:
    try:
        return engine_of(text, workers)
    except ValueError as problem:
        raise OptionError(f"--engine: found {problem}") from None


@contextmanager
def _reporting_errors() -> Iterator[None]:
    """Report an error that prevents the experiment, and exit."""
    from colony.cli.run.running import reporting_failures
    from colony.experiment.parallel import WorkersLostError
    from colony.experiment.results import ResultsError
    from colony.nav.maps.free_space import NoRoomError

    try:
        with reporting_failures():
            yield
    except (ResultsError, WorkersLostError, NoRoomError) as problem:
        say(f"error: {problem}")
        raise click.exceptions.Exit(EXIT_MISUSE) from None


# --- the design ----------------------------------------------------------------------------------


def _floor(path: str | None) -> WorldMap:
    """Return the map, before the simulator is imported, which takes long."""
    from colony.nav.maps.world_map import load_world

    if path is None:
        raise OptionError("no world: give --map MAP, such as `--map loop`")
    return load_world(path)


def _experiment(options: dict[str, Any], floor: WorldMap) -> Experiment:
    """Return the requested experiment; its behaviors compile, also with both ends of the ranges of params."""
    from colony.experiment.design import Experiment, compiled_of, sources_digest
    from colony.experiment.results import digest_of

    _expect_one_start(options)
    programs, params = _programs(options), _params(options["ranges"])
    movers = _movers(options["movers"])
    varied = {
        "hazards": 0 if options["hazards"] else None,
        "movers": movers if isinstance(movers, int) else 0,
    }
    if options["length_ns"] is None and options["goal"] is None:
        varied["length_ns"] = duration_ns(DURATION)
    compiled = [compiled_of(program) for program in programs]
    programs = tuple(
        program._replace(sources=sources_digest(each.compiled))
        for program, each in zip(programs, compiled, strict=True)
    )
    for program in programs:
        for end in ("low", "high") if params else ():
            compiled_of(program, tuple((name, values.text(getattr(values, end))) for name, values in params))
    return Experiment(
        name=f"on {compiled[0].compiled.name} in {floor.name}",
        programs=programs,
        spec=run_spec(compiled[0].program.robot, options | varied),
        runs=options["runs"],
        varies_start="start" in options["vary"],
        movers=None if isinstance(movers, int) else movers,
        params=params,
        audit=options["audit"],
        digest=digest_of([each.compiled for each in compiled], floor.files),
    )


def _expect_one_start(options: dict[str, Any]) -> None:
    """Refuse options that give a run several starts, or half of a route."""
    expect_both_ends(options)
    goal, varies_start = options["goal"], "start" in options["vary"]
    if goal is not None and (varies_start or options["start"] is not None):
        raise OptionError("--start and --vary start are for runs without --from and --to")
    if varies_start and options["start"] is not None:
        raise OptionError("--start and --vary start exclude each other")
    if options["hazards"] and goal is None:
        raise OptionError("--hazards requires --from and --to")


def _programs(options: dict[str, Any]) -> tuple[ProgramChoice, ...]:
    from colony.experiment.design import ProgramChoice

    files = [options["file"], *([options["versus"]] if options["versus"] is not None else [])]
    if len(set(files)) < len(files):
        raise OptionError("--versus: found the same file twice; expected another behavior")
    stems = [Path(file).stem for file in files]
    labels = stems if len(set(stems)) == len(stems) else files
    return tuple(
        ProgramChoice(label, file, chosen_robot(), chosen_params())
        for label, file in zip(labels, files, strict=True)
    )


def _params(texts: Sequence[str]) -> tuple[tuple[str, SweptRange], ...]:
    from colony.experiment.design import range_of

    ranges: dict[str, SweptRange] = {}
    for text in texts:
        name, equals, values = text.partition("=")
        if not (name and equals) or name in ranges:
            raise OptionError(f"--param: found `{text}`; expected each param once, as NAME=LOW..HIGH")
        try:
            ranges[name] = range_of(values)
        except ValueError as problem:
            raise OptionError(f"--param {name}: {problem}") from None
    return tuple(ranges.items())


def _movers(text: str) -> int | SweptRange:
    from colony.experiment.design import range_of

    with suppress(ValueError):
        if ".." not in text:
            if 0 <= int(text) <= MAX_MOVERS:
                return int(text)
        else:
            found = range_of(text)
            if found.is_whole and found.low >= 0 and found.high <= MAX_MOVERS:
                return found
    raise OptionError(f"--movers: found `{text}`; expected a number up to {MAX_MOVERS}, or two: 0..5")


# --- the work ------------------------------------------------------------------------------------


def _carry_out(
    experiment: Experiment, trials: Sequence[Trial], output: Path | None, engine: Engine
) -> tuple[tuple[TrialResult, ...], bool]:
    """Make the missing runs; return all results, by number, and True if the user interrupted."""
    from colony.cli.progress import experiment_progress
    from colony.experiment.results import Results
    from colony.experiment.trial import TRIALS, TrialError, run_trial

    interrupted = False
    with Results(output, TRIALS) as results:
        for program in experiment.programs:
            results.expect(experiment.name, program.label, experiment.fingerprint())
        stored = results.keys()
        missing = [trial for trial in trials if trial.key not in stored]
        try:
            with experiment_progress("runs", _is_bad, _short) as on_run:
                before = len(trials) - len(missing)
                for done, result in enumerate(engine.results(run_trial, missing), before + 1):
                    results.put(result)
                    on_run(done, len(trials), result)
        except TrialError as problem:
            raise MisuseError(f"error: {problem}") from None
        except KeyboardInterrupt:
            interrupted = True
        keys = {trial.key for trial in trials}
        found = [r for p in experiment.programs for r in results.select(experiment.name, p.label)]
    return tuple(r for r in found if r.key in keys), interrupted


def _short(result: TrialResult) -> str:
    return f"run {result.key.number}, {result.distance_mm / 1000.0:.1f} m"


def _is_bad(result: TrialResult) -> bool:
    return bool(result.contacts or result.is_stuck or result.breaches or result.arrived == 0)


def _replay(trials: Sequence[Trial], number: int) -> None:
    from colony.experiment.trial import TrialError, run_trial

    for trial in trials:
        label = "" if len(trials) == 1 else f".{Path(trial.program.file).stem}"
        name = f"run-{number}{label}.mcap"
        check_output(name)
        try:
            result = run_trial(trial, name)
        except TrialError as problem:
            raise MisuseError(f"error: {problem}") from None
        params = "".join(f", {param} = {value}" for param, value in trial.params)
        contacts = "1 contact" if result.contacts == 1 else f"{result.contacts} contacts"
        click.echo(f"wrote {name}: {result.distance_mm / 1000.0:.2f} m, {contacts}{params}")
        for contract, first_s in result.breaches.items():
            at = f"{first_s:.10g}"
            click.echo(f"  contract {contract}: BROKEN first at {at} s: colony explain {name} --at {at}")


# --- the outputs ---------------------------------------------------------------------------------


def _check_picture(path: str, floor: WorldMap) -> None:
    from colony.view.map_picture import picture_format

    try:
        picture_format(path)
    except ValueError as problem:
        raise OptionError(f"--picture: {problem}") from None
    check_output(path, floor.files)


def _print(
    experiment: Experiment, results: Sequence[TrialResult], *, interrupted: bool, as_json: bool
) -> None:
    from colony.experiment.report import comparison_of, summary_of, text_of

    if not as_json:
        total = experiment.runs * len(experiment.programs)
        if len(results) < total:
            say(f"{len(results)} of {total} runs are finished")
        if results:
            click.echo(text_of(experiment, results))
        return
    by_program = [[r for r in results if r.key.variant == p.label] for p in experiment.programs]
    comparison = comparison_of(experiment, results)
    out = {
        "experiment": experiment.name,
        "interrupted": interrupted,
        "behaviors": [
            asdict(summary_of(p.label, own))
            for p, own in zip(experiment.programs, by_program, strict=True)
            if own
        ],
        "comparison": None if comparison is None else asdict(comparison),
        "runs": [{**asdict(r), "key": r.key._asdict()} for r in results],
    }
    click.echo(json.dumps(out, indent=2))


def _draw(floor: WorldMap, results: Sequence[TrialResult], path: str) -> None:
    from colony.view.map_picture import draw_runs, encode_picture, picture_format

    figure = draw_runs(floor, [(r.path, r.places, _is_bad(r)) for r in results])
    write_whole(Path(path), encode_picture(figure, picture_format(path)))
    say(f"wrote {path}")


def _exit(results: Sequence[TrialResult], *, interrupted: bool) -> None:
    if any(r.breaches or r.difference for r in results):
        raise click.exceptions.Exit(EXIT_ERRORS)
    if interrupted:
        raise click.exceptions.Exit(EXIT_INTERRUPTED)
