"""The command `colony robot`."""

from colony.cli.robot.main import command

__all__ = ["command"]
