"""The command `colony experiment`."""

from colony.cli.experiment.main import command

__all__ = ["command"]
