"""`colony serve`: one server of a robot in the foreground, or all of them with their simulated hardware."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.places import problems_told, robot_option
from colony.cli.reporting import refuse, say
from colony.cli.shipped_files import map_option
from colony.extras import expect_extras

if TYPE_CHECKING:
    from colony.robots.serving import Settings

ALL = "all"

NAMES = ("Clock", "RServer", "PServer", "DServer", "CServer", "Simulator", "Gateway", ALL)


class Folder(click.Path):
    """A parameter type for folder names; an empty name, which would be the current folder, is refused."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the folder's path."""
        if value == "":
            self.fail("found an empty name; expected that of a folder", param, ctx)
        return super().convert(value, param, ctx)


@click.command(name="serve", short_help="be the servers of a robot")
@click.argument("server", metavar="SERVER", type=click.Choice(NAMES, case_sensitive=False))
@robot_option("The name that programs find it by.", required=True)
@map_option
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of sensors' noise.")
@click.option(
    "--hazards",
    type=click.IntRange(min=0),
    metavar="SEED",
    help="Of the simulated building: people, open doors, lights that are out and more, drawn from this seed.",
)
@click.option(
    "--camera",
    "camera_texts",
    multiple=True,
    metavar="[NAME=]DEGREES|up",
    help="A camera that looks there, counterclockwise from ahead, or up. May be repeated.",
)
@click.option(
    "--state",
    type=Folder(path_type=Path, file_okay=False),
    metavar="FOLDER",
    help="What DServer keeps, and the emergency stop (default: ~/.local/state/colony/NAME).",
)
@click.option("--fsync", is_flag=True, help="DServer's data outlives a loss of power.")
@click.option("--listen", metavar="ENDPOINT", help="Let other machines in, at tls/HOST:PORT (Gateway, all).")
@click.option(
    "--security",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="With --listen: the table of users, in TOML.",
)
def command(server: str, **given: Any) -> None:
    """Serve a robot until Ctrl-C, for programs that come and go: `colony run FILE --connect --robot NAME`.

    SERVER is Clock (the frames), RServer (the base), PServer (sonars and infrared detectors), DServer
    (variables and semaphores), CServer (a camera), Simulator (in place of the hardware), Gateway (the way in
    from other machines), or `all` of them: then each is a process of its own, and who dies is started again.

    A server stops what it drives when it ends. One that runs already, under the same name, is refused.

    \b
    Example:
      colony serve all --robot rome --map loop
      colony serve all --robot rome --map loop --listen tls/0.0.0.0:7447 --security users.toml
      colony serve Simulator --robot rome --map loop
      colony serve RServer --robot rome
    """
    from colony.cli.interruption import interruptible
    from colony.cli.run.options import OptionError, cameras
    from colony.robots.request import MisuseError, RunAbortedError
    from colony.robots.serving import Settings, serve_all, serve_one
    from colony.runtime.transport.live.place import local
    from colony.text.diagnostics import DiagnosticError

    robot, texts = given.pop("robot"), given.pop("camera_texts")
    try:
        looking = cameras(texts)
        settings = Settings(**given | {"cameras": looking, "state": given["state"] or _state_folder(robot)})
        wrong = objection(server, settings)
    except OptionError as bad:
        wrong = str(bad)
    if wrong is not None:
        raise click.UsageError(wrong, click.get_current_context())
    if settings.map_path is not None:
        expect_extras("sim")
    try:
        with problems_told():
            place = local(robot, os.environ)
            place.directory.prepare()
            if server == ALL:
                serve_all(place, settings, say, interruptible("ending the servers"))
            else:
                serve_one(server, place, settings, say)
    except MisuseError as misuse:
        say(str(misuse))
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    except DiagnosticError as failure:
        refuse(failure.diagnostics)
    except RunAbortedError as problem:
        say(f"colony: error: {problem}")
        raise click.exceptions.Exit(EXIT_ERRORS) from None


def objection(server: str, settings: Settings) -> str | None:
    """Return what is missing or invalid for this server, None if nothing is."""
    if server in ("Simulator", ALL) and settings.map_path is None:
        return f"{server} also wants --map MAP: where is the robot?"
    if server not in ("Simulator", ALL) and settings.hazards is not None:
        return f"--hazards goes with Simulator or all, not with {server}: it is of the building"
    if server == "CServer" and len(settings.cameras) != 1:
        return "CServer also wants one --camera [NAME=]DEGREES|up: that of the Simulator which it serves"
    if server == "Gateway" and settings.listen is None:
        return "Gateway also wants --listen tls/HOST:PORT"
    if (settings.listen is None) != (settings.security is None):
        return "--listen and --security go together: others are let in by a table of users"
    if settings.listen is not None and server not in ("Gateway", ALL):
        return f"--listen goes with Gateway or all, not with {server}"
    return None


def _state_folder(robot: str) -> Path:
    home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(home) / "colony" / robot
