"""`colony sim`: the simulated building by itself."""

from __future__ import annotations

import click

from colony.cli.sim.snapshot import snapshot_command


@click.group("sim", no_args_is_help=False, short_help="look at the simulated building")
def command() -> None:
    """Look at the building that the simulator makes of a map.

    \b
    Example:
      colony sim snapshot msu_engineering_3 --at 376
    """


command.add_command(snapshot_command)
