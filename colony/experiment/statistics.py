"""Proportions and means with 95 % intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Z = 1.959963984540054
"""The 97.5 % quantile of the normal distribution."""

RESAMPLES = 2000
"""Resamples of a bootstrap."""


@dataclass(frozen=True, slots=True)
class Proportion:
    """`cases` of `total`, and the interval of the probability."""

    cases: int
    total: int
    low: float
    high: float

    @property
    def share(self) -> float:
        """The observed proportion."""
        return self.cases / self.total if self.total else 0.0


@dataclass(frozen=True, slots=True)
class Mean:
    """A mean with its interval, and the least and greatest value."""

    mean: float
    low: float
    high: float
    least: float
    greatest: float


def wilson(cases: int, total: int) -> Proportion:
    """Return a proportion with its score interval (Wilson 1927), which holds for rare events, too."""
    if not total:
        return Proportion(cases, total, 0.0, 1.0)
    share, spread = cases / total, Z * Z / total
    middle = (share + spread / 2.0) / (1.0 + spread)
    half = Z / (1.0 + spread) * math.sqrt(share * (1.0 - share) / total + spread / (4.0 * total))
    return Proportion(
        cases, total, 0.0 if not cases else middle - half, 1.0 if cases == total else middle + half
    )


def mean_of(values: Sequence[float]) -> Mean:
    """Return a mean with its percentile bootstrap interval, the same for the same values.

    Args:
        values: at least one number.
    """
    array = np.array(values, dtype=np.float64)
    rng = np.random.default_rng(len(array))
    means = [array[rng.integers(0, len(array), len(array))].mean() for _ in range(RESAMPLES)]
    low, high = np.quantile(means, (0.025, 0.975)).tolist()
    return Mean(float(array.mean()), low, high, float(array.min()), float(array.max()))
