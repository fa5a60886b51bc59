"""`colony serve`: one server of a robot in the foreground, or all of them with their simulated hardware."""

from __future__ import annotations

import os
from pathlib import Path

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.places import problems_told
from colony.cli.reporting import refuse, say

ALL = "all"

NAMES = ("Clock", "RServer", "PServer", "DServer", "CServer", "Simulator", "Gateway", ALL)


@click.command(name="serve", short_help="be the servers of a robot")
@click.argument("server", metavar="SERVER", type=click.Choice(NAMES, case_sensitive=False))
@click.option("--robot", required=True, metavar="NAME", help="The name that programs find it by.")
@click.option("--map", "map_path", metavar="MAP", help="The building of the simulated robot.")
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
    type=click.Path(path_type=Path, file_okay=False),
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
def command(
    server: str,
    robot: str,
    map_path: str | None,
    seed: int,
    hazards: int | None,
    camera_texts: tuple[str, ...],
    state: Path | None,
    fsync: bool,
    listen: str | None,
    security: Path | None,
) -> None:
    """Serve a robot until Ctrl-C, for programs that come and go: `colony run FILE --connect --robot NAME`.

    SERVER is Clock (the frames), RServer (the base), PServer (sonars and infrared detectors), DServer
    (variables and semaphores), CServer (a camera), Simulator (in place of the hardware), Gateway (the way in
    from other machines), or `all` of them: then each is a process of its own, and who dies is started again.

    A server stops what it drives when it ends. One that runs already, under the same name, is refused.

    \b
    Example:
      colony serve all --robot rome --map maps/loop.stickrep
      colony serve all --robot rome --map maps/loop.stickrep --listen tls/0.0.0.0:7447 --security users.toml
      colony serve Simulator --robot rome --map maps/loop.stickrep
      colony serve RServer --robot rome
    """
    from colony.cli.run.options import BadOption, BrokenOff, Misuse, cameras
    from colony.runtime.transport.live.place import local
    from colony.text.diagnostics import Failure

    _check_choice(server, map_path, hazards, camera_texts, listen, security)
    try:
        looking = cameras(camera_texts)
    except BadOption as bad:
        raise click.UsageError(str(bad), click.get_current_context()) from None
    from colony.cli.serving import Settings, serve_all, serve_one

    settings = Settings(
        map_path=map_path,
        seed=seed,
        cameras=looking,
        state=state or _state_folder(robot),
        fsync=fsync,
        listen=listen,
        security=security,
        hazards=hazards,
    )
    try:
        with problems_told():
            place = local(robot, os.environ)
            place.directory.prepare()
            serve_all(place, settings) if server == ALL else serve_one(server, place, settings)
    except Misuse as misuse:
        say(str(misuse))
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    except Failure as failure:
        refuse(failure.diagnostics)
    except BrokenOff as problem:
        say(f"colony: error: {problem}")
        raise click.exceptions.Exit(EXIT_ERRORS) from None


def _check_choice(
    server: str,
    map_path: str | None,
    hazards: int | None,
    cameras: tuple[str, ...],
    listen: str | None,
    security: Path | None,
) -> None:
    """Options that are missing, or make no sense for this server."""
    wrong = None
    if server in ("Simulator", ALL) and map_path is None:
        wrong = f"{server} also wants --map MAP: where is the robot?"
    elif server not in ("Simulator", ALL) and hazards is not None:
        wrong = f"--hazards goes with Simulator or all, not with {server}: it is of the building"
    elif server == "CServer" and len(cameras) != 1:
        wrong = "CServer also wants one --camera [NAME=]DEGREES|up: that of the Simulator which it serves"
    elif server == "Gateway" and listen is None:
        wrong = "Gateway also wants --listen tls/HOST:PORT"
    elif (listen is None) != (security is None):
        wrong = "--listen and --security go together: others are let in by a table of users"
    elif listen is not None and server not in ("Gateway", ALL):
        wrong = f"--listen goes with Gateway or all, not with {server}"
    if wrong is not None:
        raise click.UsageError(wrong, click.get_current_context())


def _state_folder(robot: str) -> Path:
    home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(home) / "colony" / robot
