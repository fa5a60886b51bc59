"""`colony robot`: descriptions of robots, with their bodies."""

from __future__ import annotations

import click

from colony.cli.robot.check import check_command


@click.group("robot", no_args_is_help=False, short_help="check, draw and begin descriptions of robots")
def command() -> None:
    """Check, draw and begin descriptions of robots: an interface, NAME.colony, and a body, NAME.toml.

    \b
    Example:
      colony robot check rome
    """


command.add_command(check_command)
