"""`colony robot`: descriptions of robots, with their bodies."""

from __future__ import annotations

import click

from colony.cli.robot.check import check_command
from colony.cli.robot.new import new_command
from colony.cli.robot.show import show_command
from colony.cli.robot.test import test_command


@click.group("robot", no_args_is_help=False, short_help="check, draw, start and test robots")
def command() -> None:
    """Check, draw and start descriptions of robots: an interface, NAME.colony, and a body, NAME.toml. Test
    the robot that they describe.

    \b
    Example:
      colony robot check rome
      colony robot show rome --picture rome.svg
      colony robot new scout
      colony robot test rome
    """


command.add_command(check_command)
command.add_command(show_command)
command.add_command(new_command)
command.add_command(test_command)
