"""How often scripts look at images."""

from __future__ import annotations

import math

PERIOD_S, THESIS_PERIOD_S = 0.25, 0.5
"""Seconds from one look to the next: ours, and as printed in the thesis."""


def period_of(told_s: float | None, default_s: float) -> float:
    """Return the period that a script was told, or its own.

    Raises:
        ValueError: it is not a finite time above 0.
    """
    period_s = default_s if told_s is None else told_s
    if not 0.0 < period_s < math.inf:
        raise ValueError(f"period_s is {period_s!r}; expected a finite time above 0")
    return period_s
