"""The command `colony serve`."""

from colony.cli.serve.main import command

__all__ = ["command"]
