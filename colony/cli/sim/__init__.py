"""The command `colony sim`."""

from colony.cli.sim.main import command

__all__ = ["command"]
