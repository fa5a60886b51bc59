"""`colony serve`: one server of a robot in the foreground, or all of them with simulated hardware."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.reporting import refuse, report, say
from colony.cli.robot_choice import chosen_robot, robot_and_description_option
from colony.cli.robot_options import reporting_connection_errors
from colony.cli.shipped_files import map_option
from colony.extras import expect_extras

if TYPE_CHECKING:
    from colony.robots.serving import Settings
    from colony.runtime.protocol.interface import Interface

ALL = "all"

NAMES = ("Clock", "RServer", "PServer", "DServer", "CServer", "Simulator", "Gateway", ALL)


class Folder(click.Path):
    """A parameter type for folder names; an empty name, which would be the current folder, is refused."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the folder's path."""
        if value == "":
            self.fail("found an empty name; expected the name of a folder", param, ctx)
        return super().convert(value, param, ctx)


@click.command(name="serve", short_help="run the servers of a robot")
@click.argument("server", metavar="SERVER", type=click.Choice(NAMES, case_sensitive=False))
@robot_and_description_option(
    "The name by which programs find the robot. With a description (one that comes with colony, one in the "
    "folder robots, or a path), programs that were checked against another interface are refused.",
    required=True,
)
@map_option
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="The seed of the sensors' noise."
)
@click.option(
    "--hazards",
    type=click.IntRange(min=0),
    metavar="SEED",
    help="Simulate hazards drawn from this seed: people, open doors, broken lights and more.",
)
@click.option(
    "--camera",
    "camera_texts",
    multiple=True,
    metavar="[NAME=]DEGREES|up",
    help="Add a camera facing this direction, in degrees counterclockwise from straight ahead, or facing up. "
    "May be repeated.",
)
@click.option(
    "--state",
    type=Folder(path_type=Path, file_okay=False),
    metavar="FOLDER",
    help="The folder of DServer's data and of the emergency stop. [default: ~/.local/state/colony/NAME]",
)
@click.option("--fsync", is_flag=True, help="Make DServer's data survive a power failure.")
@click.option(
    "--listen",
    metavar="ENDPOINT",
    help="Accept connections from other machines at tls/HOST:PORT (Gateway, all).",
)
@click.option(
    "--security",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="With --listen: the table of users, in TOML.",
)
def command(server: str, **arguments: Any) -> None:
    """Run the servers of a robot until Ctrl-C. Programs connect with `colony run FILE --connect --robot
    NAME`.

    SERVER is Clock (the frames), RServer (the base), PServer (sonars and infrared detectors), DServer
    (variables and semaphores), CServer (a camera), Simulator (in place of the hardware), Gateway (connections
    from other machines), or `all`. With `all` each server is a process of its own, and a process that dies is
    restarted.

    A server stops its hardware when it ends. A server that already runs under the same name is not started.

    \b
    Example:
      colony serve all --robot rome --map loop
      colony serve all --robot rome --map loop --listen tls/0.0.0.0:7447 --security users.toml
      colony serve all --robot lab=rome --map loop
      colony serve Simulator --robot rome --map loop
      colony serve RServer --robot rome
    """
    from colony.cli.interruption import interruptible
    from colony.cli.run.options import OptionError, cameras
    from colony.robots.request import MisuseError, RunAbortedError
    from colony.robots.serving import Settings, serve_all, serve_one
    from colony.runtime.transport.live.robot_address import local
    from colony.text.diagnostics import DiagnosticError

    robot, texts = arguments.pop("robot"), arguments.pop("camera_texts")
    try:
        directions = cameras(texts)
        settings = Settings(
            **arguments
            | {
                "cameras": directions,
                "state": arguments["state"] or _state_folder(robot),
                "interface": _interface(),
            }
        )
        objection_text = objection(server, settings)
    except OptionError as bad:
        objection_text = str(bad)
    if objection_text is not None:
        raise click.UsageError(objection_text, click.get_current_context())
    if settings.map_path is not None:
        expect_extras("sim")
    try:
        with reporting_connection_errors():
            robot_address = local(robot, os.environ)
            robot_address.directory.prepare()
            if server == ALL:
                serve_all(robot_address, settings, say, interruptible("ending the servers"))
            else:
                serve_one(server, robot_address, settings, say)
    except MisuseError as misuse:
        say(str(misuse))
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    except DiagnosticError as failure:
        refuse(failure.diagnostics)
    except RunAbortedError as problem:
        say(f"colony: error: {problem}")
        raise click.exceptions.Exit(EXIT_ERRORS) from None


def objection(server: str, settings: Settings) -> str | None:
    """Return the reason why the settings do not fit this server; None if they do."""
    if server in ("Simulator", ALL) and settings.map_path is None:
        return f"{server} requires --map MAP, the building of the robot"
    if server not in ("Simulator", ALL) and settings.hazards is not None:
        return f"--hazards requires Simulator or all, which simulate the building; found {server}"
    if server == "CServer" and len(settings.cameras) != 1:
        return "CServer requires one --camera [NAME=]DEGREES|up, the camera of the Simulator that it serves"
    if server == "Gateway" and settings.listen is None:
        return "Gateway requires --listen tls/HOST:PORT"
    if (settings.listen is None) != (settings.security is None):
        return "--listen and --security require each other: the table of users decides who may connect"
    if settings.listen is not None and server not in ("Gateway", ALL):
        return f"--listen requires Gateway or all; found {server}"
    return None


def _interface() -> Interface | None:
    """Return the interface of the description that the options give; None if they give no more than a name.

    Exits with 1 if the description has errors.
    """
    choice = chosen_robot()
    if choice is None or choice.is_name:
        return None
    from colony.dsl.language_version import VERSION_LINE
    from colony.dsl.load import check_text
    from colony.runtime.protocol.interface import interface_of

    checked = check_text(f"{VERSION_LINE}\nimport robot\n", "--robot", robot=choice)
    if checked.program is None:
        report(checked.diagnostics)
        raise click.exceptions.Exit(EXIT_ERRORS)
    return interface_of(checked.program.robot)


def _state_folder(robot: str) -> Path:
    home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(home) / "colony" / robot
