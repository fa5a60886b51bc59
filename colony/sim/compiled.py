"""Compilation of the simulator's inner loops with numba, cached in a folder of the user alone if possible.

The annotations of a compiled function are its signature: `float`, `int`, `bool`, an array type of this file,
or a `NamedTuple` of those. A function is therefore compiled once, when it is defined.
"""

from __future__ import annotations

import os.path
from collections.abc import Callable, Mapping
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, ClassVar, ForwardRef, TypeVar, cast

import numba
import numpy as np
from numba.core import caching
from numpy.typing import NDArray

from colony.files import own_folder

Floats = NDArray[np.float64]
Floats2 = NDArray[np.float64]
Ints = NDArray[np.int64]
Ints2 = NDArray[np.int64]
Bools2 = NDArray[np.bool_]
Bytes2 = NDArray[np.uint8]

_NATIVE = {
    "float": numba.float64,
    "int": numba.int64,
    "bool": numba.boolean,
    "Floats": numba.float64[::1],
    "Floats2": numba.float64[:, ::1],
    "Ints": numba.int64[::1],
    "Ints2": numba.int64[:, ::1],
    "Bools2": numba.boolean[:, ::1],
    "Bytes2": numba.uint8[:, ::1],
}

F = TypeVar("F", bound=Callable[..., object])


_caching: Any = caching  # untyped, as some versions of numba


class _OwnFolder:
    """A folder of numba's cache that only this user can write to, in the one that numba would choose.

    Its files are unpickled, which runs code in them. With a umask of 0 numba's own folders and files are
    writable by all users.
    """

    def get_cache_path(self) -> str:
        return os.path.join(super().get_cache_path(), "own")  # type: ignore[misc]

    def ensure_cache_path(self) -> None:
        own_folder(Path(self.get_cache_path()))
        super().ensure_cache_path()  # type: ignore[misc]


class _Provided(_OwnFolder, _caching.UserProvidedCacheLocator): ...  # type: ignore[misc]


class _InTree(_OwnFolder, _caching.InTreeCacheLocator): ...  # type: ignore[misc]


class _UserWide(_OwnFolder, _caching.UserWideCacheLocator): ...  # type: ignore[misc]


class _Implementation(_caching.CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes: ClassVar[list[type]] = [_Provided, _InTree, _UserWide]


class Cache(_caching.FunctionCache):  # type: ignore[misc]
    """The cache of a compiled function."""

    _impl_class = _Implementation


def compiled(function: F) -> F:
    """Compile a function that returns nothing; later processes load it from the cache.

    Divisions follow IEEE 754 and raise nothing. Operations are not reassociated, so results are bit-identical
    in every run on a machine.
    """
    names = {**function.__annotations__}
    del names["return"]
    signature = numba.void(*(_native(name, function.__globals__) for name in names.values()))
    dispatcher: Any = numba.njit(nogil=True, error_model="numpy")(function)
    try:
        dispatcher._cache = Cache(function)
        _compile_or_load(dispatcher, signature)
    except (RuntimeError, OSError) as failure:
        if isinstance(failure, RuntimeError) and "cannot cache" not in str(failure):
            raise
        dispatcher = numba.njit(nogil=True, error_model="numpy")(function)
        dispatcher.compile(signature)
    dispatcher.disable_compile()
    return cast(F, dispatcher)


def _compile_or_load(dispatcher: Any, signature: object) -> None:
    """Compile, or load from the cache; replace a cache index that is damaged or from another version.

    Numba unpickles the index before it checks its version, so a class that was renamed since raises
    AttributeError.
    """
    try:
        dispatcher.compile(signature)
    except (AttributeError, EOFError, ImportError, UnpicklingError, ValueError):
        dispatcher._cache.flush()
        dispatcher.compile(signature)


def inlined(function: F) -> F:
    """Mark a helper that is inlined into compiled functions."""
    return cast(F, numba.njit(inline="always", error_model="numpy")(function))


def called(function: F) -> F:
    """Mark a helper that compiled functions call, because it is large or used in many places."""
    return cast(F, numba.njit(nogil=True, error_model="numpy")(function))


def _native(annotation: str | ForwardRef, names: Mapping[str, Any]) -> Any:
    """Return Numba's type for an annotation; `names` are the globals of its module."""
    name = annotation.__forward_arg__ if isinstance(annotation, ForwardRef) else annotation
    if name in _NATIVE:
        return _NATIVE[name]
    record = names[name]
    fields: Any = [_native(a, names) for a in record.__annotations__.values()]
    make: Any = numba.types.BaseTuple.from_types
    return make(fields, record)
