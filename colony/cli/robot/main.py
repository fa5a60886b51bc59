"""`colony robot`: descriptions of robots, with their bodies."""

from __future__ import annotations

from importlib.resources import files

import click

from colony.cli.robot.check import check_command
from colony.cli.robot.graph.command import import_command
from colony.cli.robot.names import FOLDER, expect_free, robot_name, write_description
from colony.cli.robot.show import show_command
from colony.cli.robot.test import test_command

# --- new -----------------------------------------------------------------------------------------------
#
# `colony robot new`: a description with its body, to begin with.


TEMPLATES = files("colony.cli") / "templates" / "robot"
SUFFIXES = (".colony", ".toml")


@click.command("new", short_help="start a description")
@click.argument("name", metavar="NAME")
def new_command(name: str) -> None:
    """Write robots/NAME/NAME.colony and NAME.toml: a small robot with a laser scanner and bumpers.

    Both pass `colony robot check`, and say how to go on. Existing files are never overwritten.

    Exit code: 0, or 2 if NAME is invalid or the name of a robot that comes with colony, or a file exists or
    cannot be written.

    \b
    Example:
      colony robot new scout
      colony robot check scout
    """
    robot_name(name)
    texts = {suffix: _filled(suffix, name) for suffix in SUFFIXES}
    folder = FOLDER / name
    paths = {suffix: folder / f"{name}{suffix}" for suffix in SUFFIXES}
    expect_free((*paths.values(), FOLDER / f"{name}.colony"))
    write_description({path: texts[suffix] for suffix, path in paths.items()})
    written = " and ".join(str(path) for path in paths.values())
    click.echo(f"wrote {written}; try: colony robot check {name}")


def _filled(suffix: str, name: str) -> str:
    return (TEMPLATES / f"NAME{suffix}").read_text(encoding="utf-8").replace("NAME", name)


# --- main ----------------------------------------------------------------------------------------------


@click.group("robot", no_args_is_help=False, short_help="check, draw, start and test robots")
def command() -> None:
    """Check, draw and start descriptions of robots: an interface, NAME.colony, and a body, NAME.toml. Test
    the robot that they describe.

    \b
    Example:
      colony robot check rome
      colony robot show rome --picture rome.svg
      colony robot new scout
      colony robot import ros2 burger
      colony robot test rome
    """


command.add_command(check_command)
command.add_command(show_command)
command.add_command(new_command)
command.add_command(import_command)
command.add_command(test_command)
