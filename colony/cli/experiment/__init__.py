"""`colony experiment`."""

from colony.cli.experiment.main import command as command
