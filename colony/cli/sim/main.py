"""`colony sim`: the simulated building, without a run."""

from __future__ import annotations

import click

from colony.cli.sim.snapshot import snapshot_command


@click.group("sim", no_args_is_help=False, short_help="inspect the simulated building")
def command() -> None:
    """Inspect the building that the simulator creates from a map.

    \b
    Example:
      colony sim snapshot msu_engineering_3 --at 376
    """


command.add_command(snapshot_command)
