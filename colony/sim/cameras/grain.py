"""The noise of cameras: normal deviates from a table, because computing each one is too slow.

`QUANTILES` is compiled into functions of other files. Their cached machine code is rebuilt when those files
change, but not when this one does.
"""

from __future__ import annotations

from functools import lru_cache
from statistics import NormalDist

import numpy as np

from colony.sim.compiled import Floats

QUANTILES = 4096
"""Number of quantiles; a power of two."""


@lru_cache(maxsize=1)
def quantiles() -> Floats:
    """Return (4096,) quantiles of the normal distribution, read-only; a random one is a normal deviate."""
    probabilities = (np.arange(QUANTILES) + 0.5) / QUANTILES
    return np.array([NormalDist().inv_cdf(probability) for probability in probabilities.tolist()])
