"""The command `colony run`."""

from colony.cli.run.main import command

__all__ = ["command"]
