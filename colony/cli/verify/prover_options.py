"""The options that limit the prover's effort."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar, cast

import click

DEFAULT_DEPTH = 4
DEFAULT_SECONDS = 10.0
"""The default effort for each contract."""

_MAX_SECONDS = 1e6

COUNTED = "It is counted in prover steps, so that results are the same on every machine."
"""The sentence about time limits of the prover in the help of options."""

_Command = TypeVar("_Command", bound=Callable[..., object])


def depth_option(runs: str) -> Callable[[_Command], _Command]:
    """Return the option `--depth`; `runs` names the runs that may be longer than the depth."""
    return click.option(
        "--depth",
        type=click.IntRange(0, 64),
        default=DEFAULT_DEPTH,
        show_default=True,
        help=f"The maximum number of frames that induction looks back; {runs} may be six times as long.",
    )


def timeout_option(default: float) -> Callable[[_Command], _Command]:
    """Return the option `--timeout`, in seconds."""
    return click.option(
        "--timeout",
        type=ProverSeconds(),
        default=default,
        show_default=True,
        metavar="SECONDS",
        help=f"The approximate time limit. {COUNTED}",
    )


class ProverSeconds(click.FloatRange):
    """A parameter type for a time in seconds, above 0 (or 0, with `allow_zero`) and at most 11 days."""

    def __init__(self, *, allow_zero: bool = False) -> None:
        super().__init__(min=0, max=_MAX_SECONDS, min_open=not allow_zero)

    def convert(self, value: str | float, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number; refuse `nan`, which no range excludes."""
        seconds = float(super().convert(cast(float, value), param, ctx))
        if math.isnan(seconds):
            self.fail(f"{value} is not in the range {self._describe_range()}", param, ctx)
        return seconds
