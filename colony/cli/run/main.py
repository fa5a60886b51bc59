"""`colony run`: compile a program and run it.

The robot is simulated, in one process and virtual time or in several processes, or is already running.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_INTERRUPTED, EXIT_MISUSE
from colony.cli.outputs import BEHAVIOR, map_option, movers_option, start_option
from colony.cli.params_choice import params_option
from colony.cli.reporting import refuse, report, say
from colony.cli.robot_choice import robot_and_description_option, say_whose_name
from colony.cli.robot_options import (
    connect_option,
    reporting_connection_errors,
    robot_address_of,
    security_option,
)
from colony.cli.run.also import also_option, other_robots
from colony.cli.run.interface import user_interface
from colony.cli.run.options import DURATION, OptionError, Options, objection, request_of
from colony.extras import expect_extras
from colony.robots.request import MisuseError, RunAbortedError

if TYPE_CHECKING:
    from colony.execute.compiled import Compiled
    from colony.robots.described import DescribedRobot
    from colony.robots.request import RunReport, RunRequest, UserInterface

PICTURE = "run.png"


@click.command(name="run", short_help="drive a robot, simulated or real")
@click.argument("file", metavar="FILE", type=BEHAVIOR)
@map_option
@click.option(
    "--processes", is_flag=True, help="Run servers, clients and simulator as processes, in real time."
)
@connect_option("Use a robot that is already running: on this machine, or behind a gateway, tls/HOST:PORT.")
@click.option(
    "--shadow",
    is_flag=True,
    help="Join a robot that is already running, as --connect does, and command nothing: show and record what "
    "would have been sent.",
)
@security_option()
@robot_and_description_option(
    "The name of the robot, if it differs from that in the program, and the description that `import robot` "
    "brings in: by default the one called NAME, else that of the project's colony.toml."
)
@click.option(
    "--physics",
    type=click.Choice(["kinematic", "mujoco"]),
    help="What moves the robot: our simulator, in the plane, or MuJoCo, where wheels drive by friction, for "
    "robots without sonars and cameras. [default: kinematic]",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="The seed of all random numbers, such as the sensors' noise.",
)
@click.option(
    "--duration",
    metavar="TIME",
    help=f"The length of the run: {DURATION} (in seconds), 90s or 2min. [default: {DURATION} with --map]",
)
@click.option("--realtime", is_flag=True, help="Run in real time, not as fast as possible.")
@click.option(
    "--record",
    metavar="PATH",
    help="Record every frame into this file: *.mcap as MCAP, others as JSON lines.",
)
@click.option(
    "--picture", metavar="PATH", help=f"Draw the path of the robot, as PNG or SVG. [default: {PICTURE}]"
)
@click.option("--no-picture", is_flag=True, help="Do not draw a picture.")
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="NAME=VALUE",
    help="Hold what the program reads at this value: a variable of DServer, as if an operator kept setting "
    "it, or a field of a device, such as a button. A number without a unit is in that of the sensor; one "
    "value fills an array. May be repeated.",
)
@click.option(
    "--scenario",
    metavar="FILE",
    type=click.Path(dir_okay=False),
    help="Change such values over time, from the beginning of the run: a file with lines such as `at 12 s "
    "estop = true`.",
)
@click.option(
    "--camera",
    "cameras",
    multiple=True,
    metavar="[NAME=]DEGREES|up",
    help="With --processes: add a camera facing this direction, in degrees counterclockwise from straight "
    "ahead, or facing up. May be repeated.",
)
@click.option(
    "--from",
    "origin",
    metavar="ROOM",
    help="With --to: the room where the robot starts, by its name on the map.",
)
@click.option(
    "--to", "goal", metavar="ROOM", help="With --from: the goal; the run ends when the robot has arrived."
)
@click.option(
    "--hazards",
    type=click.IntRange(min=0),
    metavar="SEED",
    help="With --to: simulate hazards drawn from this seed: people, open doors, broken lights and more.",
)
@start_option
@movers_option
@also_option
@params_option("A contract that is proved without them must be proved with them, too.")
@click.option(
    "--unproved",
    is_flag=True,
    help="With --params: run even if contracts are not proved with these values; the recording says so.",
)
@click.option("--fsync", is_flag=True, help="With --processes: make DServer's data survive a power failure.")
@click.option(
    "--isolate",
    is_flag=True,
    help="With --processes or --connect: run each server, and the clients, in processes of their own.",
)
@click.option(
    "--watch",
    is_flag=True,
    help="Show the run in the browser as long as it lasts, in real time; see `colony watch`.",
)
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def command(**arguments: Any) -> None:
    """Run a behavior on a robot that is simulated in the world of a map, or on a real one.

    FILE is a behavior, the name of one that comes with colony, or a compiled program (`colony compile -o
    NAME.colonyc`).

    With --map alone, everything runs in one process and in virtual time: the same seed gives the same run.
    With --processes the run is live, as on a real robot, and other programs can connect (`colony ps`, `colony
    stop`). Servers and clients share this process; the simulator, cameras, drivers and modules in Python have
    their own, and are restarted if they die. With --connect only the clients run here, for a robot that
    `colony serve` serves; without --duration they run until Ctrl-C.

    With --shadow the program runs in the shadow of a robot that is already running, also beside a driver: it
    reads what the robot measures, sends nothing, and prints what it would have sent each second and whenever
    another client wins. A recording is marked as that of a shadow. It is the first thing to do with a new
    behavior on a real robot (docs/your-robot.md).

    With --physics mujoco, MuJoCo moves a robot without sonars and cameras, such as amr: how closely it agrees
    with our simulator is in docs/physics.md.

    With --from and --to a planner and its helpers lead the robot from room to room, for a behavior that takes
    goals, such as navigator.colony. The run ends when the robot has arrived; the exit code is 1 if it has
    not. A room on another floor that elevators lead to is written `2:250R` or `msu_engineering_2:250R`. An
    operator who presses the elevator buttons is simulated; with --connect you are asked at the terminal to
    press them. With --connect the robot must stand before the room --from, on the map --map
    (docs/missions.md).

    With --movers people walk around in the world, and with --also there are other robots in it, each with a
    behavior of its own. The picture has the paths of all robots (docs/simulation.md).

    With --params each contract that is proved of the program must be proved with these values, too, or the
    run is refused. The proof is made before the first frame, unless it is in the cache (~/.cache/colony) or
    in the compiled program.

    At the end the command prints a summary (how long each client drove, the distance, the bumps, the broken
    contracts) and draws the path. Ctrl-C stops the robot, closes the recording and prints the summary; the
    exit code is then 130. A recording that fails, for example on a full disk, ends the run in the same way,
    with exit code 1.

    Exit code: 0 if all contracts held, 1 if a contract was broken, the program has errors or the run broke
    off, 2 for misuse or if the picture cannot be written.

    \b
    Example:
      colony run wander --map loop --duration 2min --seed 1
      colony run wander --map loop --record run.mcap
      colony run wander --map office --robot amr --start 3m,2m,90
      colony run wander --map loop --robot amr --movers 5 --also rome:wander --also rome:wander
      colony run navigator --map msu_engineering_3 --from 350R --to 376L
      colony run navigator --map msu_engineering_3 --from 350R --to 2:250R
      colony run navigator --connect --map loop --from 201 --to 216
      colony run teleop --map loop --realtime --set TeleopVelocity=200
      colony run warehouse --map loop --scenario stops.scenario
      colony run wander --map loop --processes --duration 30
      colony run wander --map loop --watch
      colony run wander --robot amr --map loop --physics mujoco
      colony run wander --map loop --params site.toml
      colony run wander --connect --robot rome
      colony run wander --shadow --robot rome --record shadow.mcap
      colony run wander --connect tls/rome.lab:7447 --security ada.toml
    """
    options = Options(**arguments)
    reason = objection(options)
    if reason is not None:
        raise click.UsageError(reason, click.get_current_context())
    from colony.cli.run.site import load_for_run

    if options.map_path is not None:
        vision = ["vision"] if options.goal is not None else []
        expect_extras("sim", *(["mujoco"] if options.physics == "mujoco" else []), *vision)
    if options.watch:
        expect_extras("watch")
    compiled, described = load_for_run(options.file, unproved=options.unproved)
    is_running = options.shadow or options.connect is not None
    if not is_running:
        say_whose_name(compiled.robot.name)
    picture = None if options.no_picture or is_running else options.picture or PICTURE
    with reporting_failures(), redirect_stdout(sys.stderr):  # for prints of Python modules
        from colony.cli.run.outputs import check_outputs, draw
        from colony.robots.physics_choice import expect_simulable

        request = request_of(compiled.robot, options)
        expect_simulable(request.physics, described.body, request.file)
        request = replace(
            request,
            others=other_robots(options.also, options.robot or compiled.name),
            realtime=request.realtime or options.watch,
        )
        inputs = [options.file]
        if options.map_path is not None:
            from colony.nav.maps.world_map import load_world

            inputs += load_world(options.map_path).files  # before the simulator is imported, which takes long
        check_outputs(options.record, picture, inputs)
        with user_interface(compiled, options) as ui:
            result = _drive(compiled, described, request, options, ui)
        if options.robot is not None:
            result = result._replace(summary=replace(result.summary, robot=options.robot))
        if picture is not None:
            result = draw(result, compiled.name, picture)
    _print_summary(result, options.record, picture, options.format_)


def _drive(
    compiled: Compiled, described: DescribedRobot, request: RunRequest, options: Options, ui: UserInterface
) -> RunReport:
    if not (options.processes or options.shadow) and options.connect is None:
        from colony.sim.compiling import announcing_compilation

        with announcing_compilation(say):
            from colony.robots.building_run import run_in_building
        return run_in_building(compiled, described, request, ui)
    with reporting_connection_errors():
        name = compiled.name if options.robot is None else options.robot
        robot_address = robot_address_of(name, options.connect, options.security)
        if options.shadow:
            from colony.robots.shadow_run import run_shadow

            return run_shadow(compiled, described, robot_address, request, ui)
        from colony.robots.process_run import run_served, run_simulated
        from colony.runtime.transport.live.robot_address import Local

        if options.connect is None and isinstance(robot_address, Local):
            return run_simulated(compiled, described, robot_address, request, ui)
        return run_served(compiled, described, robot_address, request, ui)


@contextmanager
def reporting_failures() -> Iterator[None]:
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


def _print_summary(result: RunReport, record: str | None, picture: str | None, format_: str) -> None:
    summary, mission_result = result.summary, result.mission_result
    if format_ == "json":
        outputs: dict[str, object] = {"recording": record, "picture": picture}
        if mission_result is not None:
            outputs["arrival"] = mission_result._asdict()
        click.echo(json.dumps(summary.as_json() | outputs, indent=2))
    else:
        from colony.runtime.observe.summary import render

        click.echo(render(summary))
        for path in (record, picture, *(() if mission_result is None else mission_result.pictures)):
            if path is not None and path not in summary.unwritten:
                click.echo(f"  wrote {path}")
        if mission_result is not None:
            click.echo(f"  {mission_result.text}")
    if mission_result is not None and not mission_result.arrived and not summary.interrupted:
        raise click.exceptions.Exit(EXIT_ERRORS)
    if not summary.succeeded:
        raise click.exceptions.Exit(EXIT_ERRORS)
    if summary.interrupted:
        raise click.exceptions.Exit(EXIT_INTERRUPTED)
    if summary.unwritten:
        raise click.exceptions.Exit(EXIT_MISUSE)
