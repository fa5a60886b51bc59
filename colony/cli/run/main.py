"""`colony run`: compile a program and run it on a simulated robot, in one process or in several."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from colony.cli.outputs import map_option
from colony.cli.reporting import say
from colony.cli.robot_choice import say_whose_name
from colony.cli.robot_options import reporting_connection_errors
from colony.cli.run.also import also_option, other_robots
from colony.cli.run.options import (
    DURATION,
    OptionError,
    behavior_argument,
    camera_option,
    duration_ns,
    duration_option,
    expect_both_ends,
    format_option,
    goal_option,
    movers_option,
    origin_option,
    record_option,
    robot_option,
    run_spec,
    scenario_option,
    seed_option,
    settings_option,
    site_option,
    start_option,
    unproved_option,
    watch_option,
)
from colony.extras import expect_extras
from colony.text.wording import quoted

if TYPE_CHECKING:
    from colony.body.model import Body
    from colony.execute.compiled import Compiled
    from colony.ir.program import Robot
    from colony.runs.described import DescribedRobot
    from colony.runs.spec import RunReport, RunSpec, UserInterface

PICTURE = "run.png"

_MOVED = {"--connect": "colony drive", "--security": "colony drive", "--shadow": "colony shadow"}
"""Options that other commands have, with these commands."""


class _RunCommand(click.Command):
    """The command, which knows the options of its neighbors."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments; name the command that has an option which this one lacks."""
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as problem:
            if problem.option_name not in _MOVED:
                raise
            command = _MOVED[problem.option_name]
            raise OptionError(f"{problem.option_name} is an option of `{command}`", ctx) from None


@click.command(name="run", cls=_RunCommand, short_help="run a behavior on a simulated robot")
@behavior_argument
@map_option
@click.option(
    "--processes", is_flag=True, help="Run servers, clients and simulator as processes, in real time."
)
@click.option(
    "--isolate", is_flag=True, help="Like --processes, with a process for each server, and for the clients."
)
@robot_option
@click.option(
    "--physics",
    type=click.Choice(["kinematic", "mujoco"]),
    default="kinematic",
    show_default=True,
    help="What moves the robot: our simulator, in the plane, or MuJoCo, where wheels drive by friction, for "
    "robots without sonars and cameras.",
)
@seed_option
@duration_option(f"{DURATION}, with --to until the robot has arrived")
@click.option("--realtime", is_flag=True, help="Run in real time, not as fast as possible.")
@record_option
@click.option(
    "--picture", metavar="PATH", help=f"Draw the path of the robot, as PNG or SVG. [default: {PICTURE}]"
)
@click.option("--no-picture", is_flag=True, help="Do not draw a picture.")
@settings_option
@scenario_option
@camera_option("With --processes: ")
@origin_option
@goal_option
@click.option(
    "--hazards",
    type=click.IntRange(min=0),
    metavar="SEED",
    help="With --to: simulate hazards drawn from this seed: people, open doors, broken lights and more.",
)
@start_option
@movers_option
@also_option
@site_option
@unproved_option
@click.option("--fsync", is_flag=True, help="With --processes: make DServer's data survive a power failure.")
@watch_option
@format_option
def command(**options: Any) -> None:
    """Run a behavior on a robot that is simulated in the world of a map.

    FILE is a behavior, the name of one that comes with colony, or a compiled program (`colony compile -o
    NAME.colonyc`). A robot that is served, real or simulated, is driven by `colony drive`.

    By default everything runs in one process and in virtual time: the same seed gives the same run. With
    --processes the run is live, as on a real robot, and other programs can connect (`colony ps`, `colony
    stop`). Servers and clients share this process; the simulator, cameras, drivers and modules in Python have
    their own, and are restarted if they die.

    With --physics mujoco, MuJoCo moves a robot without sonars and cameras, such as amr: how closely it agrees
    with our simulator is in docs/physics.md.

    With --from and --to a planner and its helpers lead the robot from room to room, for a behavior that takes
    goals, such as navigator.colony. The run ends when the robot has arrived; the exit code is 1 if it has
    not. A room on another floor that elevators lead to is written `2:250R` or `msu_engineering_2:250R`; an
    operator who presses the elevator buttons is simulated (docs/missions.md).

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
      colony run teleop --map loop --realtime --set TeleopVelocity=200
      colony run warehouse --map loop --scenario stops.scenario
      colony run wander --map loop --processes --duration 30
      colony run wander --map loop --watch
      colony run wander --robot amr --map loop --physics mujoco
      colony run wander --map loop --params site.toml
    """
    options["processes"] |= options["isolate"]
    _expect_combination(options)
    if options["length_ns"] is None and options["goal"] is None:
        options["length_ns"] = duration_ns(DURATION)
    options["realtime"] |= options["watch"]
    from colony.cli.run.interface import user_interface
    from colony.cli.run.running import (
        check_outputs,
        draw,
        load_for_run,
        named,
        print_summary,
        reporting_failures,
    )

    vision = ["vision"] if options["goal"] is not None else []
    expect_extras("sim", *(["mujoco"] if options["physics"] == "mujoco" else []), *vision)
    if options["watch"]:
        expect_extras("watch")
    compiled, described = load_for_run(options["file"], unproved=options["unproved"])
    say_whose_name(compiled.robot)
    _say_unsimulated(compiled.robot, described.body)
    picture = None if options["no_picture"] else options["picture"] or PICTURE
    with reporting_failures(), redirect_stdout(sys.stderr):  # for prints of Python modules
        from colony.runs.spec import expect_simulable

        spec = run_spec(compiled.robot, options)
        expect_simulable(spec.physics, described.body, spec.file)
        spec = replace(spec, others=other_robots(options["also"], spec.robot or compiled.name))
        check_outputs(spec, picture)
        with user_interface(compiled, spec, watch=options["watch"]) as ui:
            run = _run_in_processes if options["processes"] else _run_in_virtual_time
            result = named(run(compiled, described, spec, ui), spec)
        if picture is not None:
            result = draw(result, compiled.name, picture)
    print_summary(result, spec.record, picture, options["format_"])


def _say_unsimulated(robot: Robot, body: Body) -> None:
    """Say which servers of a program have a real device, and none in the simulator."""
    from colony.runtime.protocol.bindings import bound_servers

    tables = {name: body.servers.get(name) for name in bound_servers(robot)}
    found = [
        n for n, table in tables.items() if table is not None and table.is_real and body.device(n) is None
    ]
    if found:
        has = "have no device" if found[1:] else "has no device"
        say(f"{quoted(found)} {has} in the simulator (`simulated` in the body): its fields have no values")


_FLAGS = {"cameras": "--camera", "goal": "--to", "mujoco": "--physics mujoco"}
"""Options whose fields have other names, with their spelling."""

_REQUIRED = (("cameras", "processes"), ("fsync", "processes"), ("hazards", "goal"))
"""Options, each with another that it requires."""

_EXCLUDED: tuple[tuple[str, tuple[str, ...], str], ...] = (
    ("goal", ("start",), "a route begins at the room --from"),
    ("goal", ("movers", "also"), "--hazards has people in the corridors"),
    ("processes", ("also",), "other robots run in virtual time"),
    ("mujoco", ("goal",), "MuJoCo simulates no sonars, cameras and elevators"),
    ("mujoco", ("processes", "movers", "also"), "MuJoCo simulates one robot, in virtual time"),
)
"""Options with those that each excludes, and the reason."""


def _expect_combination(options: Mapping[str, Any]) -> None:
    """Refuse options that exclude or require each other.

    Raises:
        OptionError: there are such options.
    """
    if options["map_path"] is None:
        raise OptionError("no robot: give --map MAP to simulate one, or `colony drive` one that is served")
    expect_both_ends(options)
    given = {name for name, value in options.items() if value}
    given |= {"hazards"} if options["hazards"] is not None else set()
    given |= {"mujoco"} if options["physics"] == "mujoco" else set()
    for option, other in _REQUIRED:
        if option in given and other not in given:
            raise OptionError(f"{_flag(option)} requires {_flag(other)}")
    for option, others, reason in _EXCLUDED:
        for other in others:
            if {option, other} <= given:
                raise OptionError(f"{_flag(option)} excludes {_flag(other)}: {reason}")


def _flag(option: str) -> str:
    return _FLAGS.get(option, f"--{option}")


def _run_in_virtual_time(
    compiled: Compiled, described: DescribedRobot, spec: RunSpec, ui: UserInterface
) -> RunReport:
    from colony.sim.compiling import announcing_compilation

    with announcing_compilation(say):
        from colony.runs.building_run import run_in_building
    return run_in_building(compiled, described, spec, ui)


def _run_in_processes(
    compiled: Compiled, described: DescribedRobot, spec: RunSpec, ui: UserInterface
) -> RunReport:
    from colony.cli.run.led_run import run_simulated
    from colony.runtime.transport.live.robot_address import local

    with reporting_connection_errors():
        robot_address = local(compiled.name if spec.robot is None else spec.robot, os.environ)
        return run_simulated(compiled, described, robot_address, spec, ui)
