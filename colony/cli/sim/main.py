"""`colony sim`: the simulated building, and what a simulated robot reads in it."""

from __future__ import annotations

import click

from colony.cli.sim.hold import hold_command
from colony.cli.sim.snapshot import snapshot_command


@click.group("sim", no_args_is_help=False, short_help="look into the simulated building, press buttons")
def command() -> None:
    """Inspect the building that the simulator creates from a map, and press the buttons of robots in it.

    \b
    Example:
      colony sim snapshot msu_engineering_3 --at 376
      colony sim hold Panel.estop=true --for 3s
    """


command.add_command(snapshot_command)
command.add_command(hold_command)
