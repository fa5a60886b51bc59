"""The options of commands that make many runs: audits, workers, engine, and the file of results."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from colony.experiment.parallel import Engine


def _fraction(context: click.Context, option: click.Parameter, value: float) -> float:
    """Return a fraction from 0 to 1; a click range would let NaN through."""
    if not 0.0 <= value <= 1.0:
        raise click.BadParameter(f"`{value:g}`; expected a fraction of the runs, from 0 to 1")
    return value


audit_option = click.option(
    "--audit",
    type=float,
    callback=_fraction,
    default=0.0,
    metavar="FRACTION",
    help="Compare this fraction of the runs, 0 to 1, with the reference interpreter.",
)
"""`--audit FRACTION`."""

workers_option = click.option(
    "--workers",
    type=click.IntRange(min=1),
    metavar="N",
    help="The number of processes. [default: one per core]",
)
"""`--workers N`."""

engine_option = click.option(
    "--engine",
    default="pool",
    show_default=True,
    metavar="WHERE",
    help="pool, serial, dask or dask=tcp://HOST:PORT.",
)
"""`--engine WHERE`, as text; see `engine_of`."""

results_option = click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PATH",
    help="The file of results (SQLite); runs that it already contains are not repeated.",
)
"""`--output PATH` of results, as `output`."""


def engine_of(text: str, workers: int | None) -> Engine:
    """Return the engine that a text names.

    Raises:
        ValueError: the text names none; the message has the text, and what was expected.
    """
    from colony.experiment.dask_engine import DaskEngine
    from colony.experiment.parallel import PoolEngine, SerialEngine

    name, _, address = text.partition("=")
    match name:
        case "pool" if not address:
            return PoolEngine(workers)
        case "serial" if not address:
            return SerialEngine()
        case "dask":
            return DaskEngine(address, workers)
        case _:
            raise ValueError(f"`{text}`; expected pool, serial, dask or dask=tcp://HOST:PORT")
