"""The command `colony map`."""

from colony.cli.map.main import command

__all__ = ["command"]
