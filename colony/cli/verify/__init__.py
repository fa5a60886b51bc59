"""The command `colony verify`."""

from colony.cli.verify.main import command

__all__ = ["command"]
