"""Arrays as the commonest value and the few elements that differ from it, named as tests write them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from colony.ir.bearings import index_text
from colony.ir.types import Array, ScalarValue, Type

_MAX_DIFFERING = 6
"""Maximum number of differing elements; arrays with more are written in full."""


class Sparse(NamedTuple):
    """An array: its commonest value, and the index and value of each other element."""

    common: ScalarValue
    differing: tuple[tuple[int, ScalarValue], ...]


def differing(
    values: tuple[ScalarValue, ...], common: tuple[ScalarValue, ...]
) -> tuple[tuple[int, ScalarValue], ...] | None:
    """Return the elements that differ from those of `common`, with their indices; None if they are many."""
    found = tuple((i, x) for i, (x, y) in enumerate(zip(values, common, strict=True)) if x != y)
    return found if len(found) <= _MAX_DIFFERING else None


def sparse(values: tuple[ScalarValue, ...]) -> Sparse | None:
    """Return an array as its commonest value and the others; None if many elements differ from it."""
    [(common, _), *_] = Counter(values).most_common(1)
    others = differing(values, (common,) * len(values))
    return None if others is None else Sparse(common, others)


def sparse_text(
    values: tuple[ScalarValue, ...], type_: Type, text: Callable[[ScalarValue], str]
) -> str | None:
    """Return `all 5 m, [0 deg] 0.4 m`; None if many elements differ."""
    found = sparse(values)
    if found is None:
        return None
    bearings = type_.bearings if isinstance(type_, Array) else None
    others = (f"[{index_text(bearings, i)}] {text(x)}" for i, x in found.differing)
    return ", ".join((f"all {text(found.common)}", *others))
