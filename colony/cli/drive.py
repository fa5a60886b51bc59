"""`colony drive`: run a behavior on a robot that is served."""

from __future__ import annotations

from typing import Any

import click

from colony.cli.outputs import map_option
from colony.cli.robot_options import connect_option, security_option
from colony.cli.run.options import (
    OptionError,
    behavior_argument,
    duration_option,
    expect_both_ends,
    format_option,
    goal_option,
    origin_option,
    record_option,
    robot_option,
    scenario_option,
    seed_option,
    settings_option,
    site_option,
    unproved_option,
    watch_option,
)
from colony.extras import expect_extras


@click.command(name="drive", short_help="run a behavior on a robot that is served")
@behavior_argument
@robot_option
@connect_option()
@security_option()
@seed_option
@duration_option("until Ctrl-C, with --to until the robot has arrived")
@record_option
@settings_option
@scenario_option
@map_option
@origin_option
@goal_option
@site_option
@unproved_option
@click.option("--isolate", is_flag=True, help="Run the clients in processes of their own.")
@watch_option
@format_option
def command(**options: Any) -> None:
    """Run a behavior on a robot that `colony serve` serves, with real or simulated devices.

    FILE is a behavior, the name of one that comes with colony, or a compiled program (`colony compile -o
    NAME.colonyc`). Only the clients run here; without --duration they run until Ctrl-C. The robot runs on
    this machine, or with --connect tls/HOST:PORT behind a gateway. Before you drive a real robot, see what
    the behavior would do: `colony shadow`.

    With --map, --from and --to a planner and its helpers lead the robot from room to room, for a behavior
    that takes goals, such as navigator.colony. The robot must stand before the room --from; you are asked at
    the terminal to press the buttons of elevators (docs/missions.md). The exit code is 1 if the robot has
    not arrived.

    Params, summary, recording and exit code are as for `colony run`.

    \b
    Example:
      colony drive wander --robot rome
      colony drive wander --robot rome --duration 2min --record run.mcap
      colony drive wander --connect tls/rome.lab:7447 --security ada.toml
      colony drive navigator --map loop --from 201 --to 216
      colony drive wander --robot rome --params site.toml
    """
    expect_both_ends(options)
    if options["goal"] is not None and options["map_path"] is None:
        raise OptionError("--to requires --map MAP, the building to drive through")
    if options["map_path"] is not None and options["goal"] is None:
        raise OptionError("--map is for --from and --to: the robot is already running")
    from colony.cli.run.interface import user_interface
    from colony.cli.run.led_run import run_served
    from colony.cli.run.running import run_on_served

    if options["goal"] is not None:
        expect_extras("sim", "vision")
    if options["watch"]:
        expect_extras("watch")
    run_on_served(
        run_served, lambda compiled, spec: user_interface(compiled, spec, watch=options["watch"]), options
    )
