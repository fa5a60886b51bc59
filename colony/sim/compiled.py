"""Compilation of the simulator's inner loops with numba, kept on disk where the disk allows it.

Compiled functions say in their annotations what they take: `float`, `int`, an array type of this file, or a
`NamedTuple` of those. The annotations are the signature, so that everything is compiled when it is defined
and nothing is compiled twice.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ForwardRef, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Floats2 = NDArray[np.float64]
Ints = NDArray[np.int64]
Ints2 = NDArray[np.int64]
Bools2 = NDArray[np.bool_]
Bytes2 = NDArray[np.uint8]

_NATIVE = {
    "float": numba.float64,
    "int": numba.int64,
    "Floats": numba.float64[::1],
    "Floats2": numba.float64[:, ::1],
    "Ints": numba.int64[::1],
    "Ints2": numba.int64[:, ::1],
    "Bools2": numba.boolean[:, ::1],
    "Bytes2": numba.uint8[:, ::1],
}

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a function that returns nothing, now; later processes load it from the cache.

    Divisions follow IEEE 754 and raise nothing. Nothing is reassociated, so results are the same bit for
    bit in every run on one machine.
    """
    names = {**function.__annotations__}
    del names["return"]
    signature = numba.void(*(_native(name, function.__globals__) for name in names.values()))
    try:
        return cast(F, numba.njit(signature, cache=True, nogil=True, error_model="numpy")(function))
    except (RuntimeError, OSError) as failure:
        if isinstance(failure, RuntimeError) and "cannot cache" not in str(failure):
            raise
        return cast(F, numba.njit(signature, nogil=True, error_model="numpy")(function))


def inlined(function: F) -> F:
    """Mark a helper of compiled functions: it becomes part of each of them."""
    return cast(F, numba.njit(inline="always", error_model="numpy")(function))


def called(function: F) -> F:
    """Mark a helper of compiled functions that is large or used in many places: they call it."""
    return cast(F, numba.njit(nogil=True, error_model="numpy")(function))


def _native(annotation: str | ForwardRef, names: Mapping[str, Any]) -> Any:
    """Return Numba's type for an annotation of the module whose global names are given."""
    name = annotation.__forward_arg__ if isinstance(annotation, ForwardRef) else annotation
    if name in _NATIVE:
        return _NATIVE[name]
    record = names[name]
    fields: Any = [_native(a, names) for a in record.__annotations__.values()]
    make: Any = numba.types.BaseTuple.from_types
    return make(fields, record)
