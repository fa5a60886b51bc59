"""`colony run`: compile a program and run it.

It runs on a simulated robot in one process and in virtual time, on one of real processes, or on a robot that
runs already.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING, Any

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_INTERRUPTED, EXIT_MISUSE
from colony.cli.places import connect_option, place_of, problems_told, robot_option, security_option
from colony.cli.reporting import refuse, report, say
from colony.cli.run.options import DURATION, OptionError, Options, objection, request_of
from colony.cli.shipped_files import BEHAVIOR, map_option
from colony.extras import expect_extras
from colony.robots.request import MisuseError, RunAbortedError

if TYPE_CHECKING:
    from colony.execute.compiled import Compiled
    from colony.robots.request import Driven, RunRequest

PICTURE = "run.png"


@click.command(name="run", short_help="drive a robot, simulated or real")
@click.argument("file", metavar="FILE", type=BEHAVIOR)
@map_option
@click.option(
    "--processes", is_flag=True, help="Servers, clients and simulator as processes, by the wall clock."
)
@connect_option("Run it on a robot that is there: on this machine, or behind a gateway, tls/HOST:PORT.")
@security_option()
@robot_option("The robot's name, if not as in the program.")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Of chance and of the sensors' noise.",
)
@click.option("--duration", metavar="TIME", help=f"As {DURATION} (the default in a building), 90s or 2min.")
@click.option("--realtime", is_flag=True, help="As fast as the wall clock, not as fast as possible.")
@click.option("--record", metavar="PATH", help="Write every frame there: MCAP into *.mcap, else JSON lines.")
@click.option("--picture", metavar="PATH", help=f"PNG or SVG of the way (default: {PICTURE}).")
@click.option("--no-picture", is_flag=True, help="Draw nothing.")
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="NAME=VALUE",
    help="Hold a variable of DServer, as if an operator kept setting it. May be repeated.",
)
@click.option(
    "--camera",
    "cameras",
    multiple=True,
    metavar="[NAME=]DEGREES|up",
    help="With --processes: a camera that looks there, counterclockwise from ahead, or up. May be repeated.",
)
@click.option("--from", "origin", metavar="ROOM", help="With --to: drive from there, by the map's names.")
@click.option("--to", "goal", metavar="ROOM", help="Where to; the run ends when the robot has arrived.")
@click.option(
    "--hazards",
    type=click.IntRange(min=0),
    metavar="SEED",
    help="With --to: people, open doors, lights that are out and more, drawn from this seed.",
)
@click.option("--fsync", is_flag=True, help="With --processes: DServer's data outlives a loss of power.")
@click.option("--isolate", is_flag=True, help="Of processes: each client is one of its own.")
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def command(**given: Any) -> None:
    """Run a behavior on a robot that is simulated in the building of a map, or on a real one.

    FILE is a behavior, the name of one that comes with colony, or what `colony compile` made of one (`-o
    NAME.colonyc`).

    With --map alone everything is one process, in virtual time: the same seed gives the same run. With
    --processes each server is a process, as on a robot, and the clients share one (with --isolate each
    client has its own); who dies is started again, and other programs can take part (`colony ps`, `colony
    stop`). With --connect only the clients are started, for a robot that `colony serve` serves; without
    --duration until Ctrl-C.

    --from and --to have a planner and its helpers lead the robot from room to room, for a behavior that takes
    goals, as navigator.colony does; the run ends when it has arrived, with exit code 1 where it did not. A
    room of another floor is `2:250R` or `msu_engineering_2:250R`, where elevators lead there: in one process
    somebody is simulated who presses their buttons, with --connect you are asked to at the terminal. A robot
    that is there has to stand before the room --from, and its map is --map (docs/missions.md).

    In the end it tells who drove how long, how far the robot came, what it bumped into, which contracts
    broke, and draws its way. Ctrl-C stops the robot, closes the recording and still tells what was run, with
    exit code 130. A recording that cannot be written any more, on a full disk for one, ends the run in the
    same way, with exit code 1.

    Exit code 0 where all contracts held, 1 where one was broken, the program has errors or the run broke
    off, 2 for misuse or where the picture cannot be written.

    \b
    Example:
      colony run wander --map loop --duration 2min --seed 1
      colony run wander --map loop --record run.mcap
      colony run navigator --map msu_engineering_3 --from 350R --to 376L
      colony run navigator --map msu_engineering_3 --from 350R --to 2:250R
      colony run navigator --connect --map loop --from 201 --to 216
      colony run teleop --map loop --realtime --set TeleopVelocity=200
      colony run wander --map loop --processes --duration 30
      colony run wander --connect --robot rome
      colony run wander --connect tls/rome.lab:7447 --security ada.toml
    """
    options = Options(**given)
    wrong = objection(options)
    if wrong is not None:
        raise click.UsageError(wrong, click.get_current_context())
    from colony.cli.programs import load_compiled

    if options.map_path is not None:
        expect_extras("sim", *(["vision"] if options.goal is not None else []))
    compiled = load_compiled(options.file)
    picture = None if options.no_picture or options.connect is not None else options.picture or PICTURE
    with _failures_told(), redirect_stdout(sys.stderr):  # for prints of Python modules
        from colony.cli.run.outputs import check_outputs, drawn
        from colony.nav.maps.stickrep.reader import load_map

        request = request_of(compiled.robot, options)
        check_outputs(options.record, picture, [p for p in (options.file, options.map_path) if p is not None])
        if options.map_path is not None:
            load_map(options.map_path)  # before the simulator is imported, which takes long
        driven = _driven(compiled, request, options)
        if picture is not None:
            driven = drawn(driven, compiled.name, picture)
    _tell(driven, options.record, picture, options.format_)


def _driven(compiled: Compiled, request: RunRequest, options: Options) -> Driven:
    from colony.cli.run.attending import ATTENDANT

    if not options.processes and options.connect is None:
        from colony.sim.compiling import told_when_compiling

        with told_when_compiling(say):
            from colony.robots.building_run import run_in_building
        return run_in_building(compiled, request, ATTENDANT)
    with problems_told():
        from colony.robots.process_run import run_here, run_there
        from colony.runtime.transport.live.place import Local

        name = compiled.name if options.robot is None else options.robot
        place = place_of(name, options.connect, options.security)
        if options.connect is None and isinstance(place, Local):
            return run_here(compiled, place, request, ATTENDANT)
        return run_there(compiled, place, request, ATTENDANT)


@contextmanager
def _failures_told() -> Iterator[None]:
    """Report an error that prevents or ends a run, and exit with its code."""
    from colony.text.diagnostics import DiagnosticError

    try:
        yield
    except OptionError as bad:
        raise click.UsageError(str(bad), click.get_current_context()) from None
    except MisuseError as misuse:
        say(str(misuse))
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    except RunAbortedError as problem:
        say(f"colony: error: {problem}")
        raise click.exceptions.Exit(EXIT_ERRORS) from None
    except DiagnosticError as failure:
        if failure.diagnostics[0].code.startswith("M"):
            refuse(failure.diagnostics)
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_ERRORS) from None


def _tell(driven: Driven, record: str | None, picture: str | None, format_: str) -> None:
    summary, arrival = driven.summary, driven.arrival
    if format_ == "json":
        written: dict[str, object] = {"recording": record, "picture": picture}
        if arrival is not None:
            written["arrival"] = arrival._asdict()
        click.echo(json.dumps(summary.as_json() | written, indent=2))
    else:
        from colony.runtime.observe.summary import render

        click.echo(render(summary))
        for path in (record, picture, *(() if arrival is None else arrival.pictures)):
            if path is not None and path not in summary.unwritten:
                click.echo(f"  wrote {path}")
        if arrival is not None:
            click.echo(f"  {arrival.text}")
    if arrival is not None and not arrival.arrived and not summary.interrupted:
        raise click.exceptions.Exit(EXIT_ERRORS)
    if not summary.sound:
        raise click.exceptions.Exit(EXIT_ERRORS)
    if summary.interrupted:
        raise click.exceptions.Exit(EXIT_INTERRUPTED)
    if summary.unwritten:
        raise click.exceptions.Exit(EXIT_MISUSE)
