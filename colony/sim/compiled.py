"""Compilation of the simulator's inner loops with numba, kept on disk where the disk allows it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

F = TypeVar("F", bound=Callable[..., object])


def compiled(signature: str) -> Callable[[F], F]:
    """Compile a function for one signature, when it is defined; later processes load it from the cache.

    Divisions follow IEEE 754 and raise nothing. Nothing is reassociated, so results are the same bit for
    bit in every run on one machine.
    """

    def decorate(function: F) -> F:
        try:
            return cast(F, numba.njit(signature, cache=True, nogil=True, error_model="numpy")(function))
        except RuntimeError as failure:
            if "cannot cache" not in str(failure):
                raise
            return cast(F, numba.njit(signature, nogil=True, error_model="numpy")(function))

    return decorate


def inlined(function: F) -> F:
    """Mark a helper of compiled functions; it is compiled together with each of them."""
    return cast(F, numba.njit(nogil=True, error_model="numpy")(function))
