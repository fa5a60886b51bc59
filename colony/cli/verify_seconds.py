"""The time that an option allows a prover."""

from __future__ import annotations

import math
from typing import cast

import click

_MOST = 1e6


class ProverSeconds(click.FloatRange):
    """Seconds of at most 11 days, above 0 unless `none` says that no time at all is allowed, too."""

    def __init__(self, *, none: bool = False) -> None:
        super().__init__(min=0, max=_MOST, min_open=not none)

    def convert(self, value: str | float, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number; what is no number at all (`nan`), and neither below nor above any, is refused too."""
        seconds = float(super().convert(cast(float, value), param, ctx))
        if math.isnan(seconds):
            self.fail(f"{value} is not in the range {self._describe_range()}", param, ctx)
        return seconds
