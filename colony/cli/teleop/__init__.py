"""The command `colony teleop`."""

from colony.cli.teleop.main import command

__all__ = ["command"]
