"""Behaviors and maps on the command line: a path, or the name of a file shipped with colony."""

from __future__ import annotations

import os
from typing import Any

import click

from colony.shipped import Shipped


class ShippedFile(click.ParamType):  # type: ignore[type-arg]
    """A parameter type for a file's path; `description` describes it in help texts."""

    def __init__(self, kind: Shipped, noun: str) -> None:
        self.name = kind.name.lower()
        self.description = f"{noun}, or the name of one that comes with colony"
        self._kind = kind

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return an existing path as it is, or the path of the shipped file with this name."""
        return self._kind.find(os.fspath(value))


BEHAVIOR = ShippedFile(Shipped.BEHAVIOR, "a behavior")
MAP = ShippedFile(Shipped.MAP, "a StickRep map or an occupancy grid (*.yaml)")

map_option = click.option("--map", "map_path", metavar="MAP", type=MAP, help=f"The world: {MAP.description}.")
"""`--map MAP`, as `map_path`."""

start_option = click.option(
    "--start",
    metavar="X,Y,HEADING",
    help="Where the simulated robot starts: in mm and degrees counterclockwise from north, or with units. "
    "[default: the start of the map; in a grid 0,0,270, or the nearest place with room]",
)
"""`--start X,Y,HEADING`, as text."""

MAX_MOVERS = 1_000

movers_option = click.option(
    "--movers",
    type=click.IntRange(0, MAX_MOVERS),
    metavar="N",
    default=0,
    help="Simulate N people who walk around between free places that the seed gives.",
)
"""`--movers N`."""
