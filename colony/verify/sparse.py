"""Arrays as the commonest value and the few runs that differ from it, named as tests write them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from typing import NamedTuple

from colony.ir.bearings import Bearings, between, index_text, naming_angle
from colony.ir.types import ScalarValue, Type, bearings_of

_MAX_RUNS = 6
"""Maximum number of differing runs; arrays with more are written in full."""

_MAX_SHOWN = 24
"""Maximum number of elements, or of runs of a longer array, that people are shown."""


class Run(NamedTuple):
    """Adjacent elements with one value, from `first` to `last`, in a ring perhaps through its end."""

    first: int
    last: int
    value: ScalarValue


class Sparse(NamedTuple):
    """An array: its commonest value, and the runs of the other elements."""

    common: ScalarValue
    differing: tuple[Run, ...]


def differing(
    values: tuple[ScalarValue, ...], common: tuple[ScalarValue, ...], bearings: Bearings | None
) -> tuple[Run, ...] | None:
    """Return the runs that differ from `common`, by index; None if they are many."""
    found = _runs(values, common, bearings)
    return found if len(found) <= _MAX_RUNS else None


def sparse(values: tuple[ScalarValue, ...], bearings: Bearings | None) -> Sparse | None:
    """Return an array as its commonest value and the others; None if many runs differ from it."""
    common = _commonest(values)
    others = differing(values, (common,) * len(values), bearings)
    return None if others is None else Sparse(common, others)


def sparse_text(
    values: tuple[ScalarValue, ...], type_: Type, text: Callable[[ScalarValue], str]
) -> str | None:
    """Return `all 5 m, [-30 deg .. 30 deg] 0.4 m`; None for a short array of which many elements differ."""
    common, bearings = _commonest(values), bearings_of(type_)
    runs = _runs(values, (common,) * len(values), bearings)
    if len(runs) > _MAX_RUNS and len(values) <= _MAX_SHOWN:
        return None
    parts = [f"[{run_text(bearings, run)}] {text(run.value)}" for run in runs[:_MAX_SHOWN]]
    if len(runs) > _MAX_SHOWN:
        parts.append(f"and {len(runs) - _MAX_SHOWN} more ranges")
    return ", ".join((f"all {text(common)}", *parts))


def run_text(bearings: Bearings | None, run: Run) -> str:
    """Return the index or slice of a run: `-30 deg .. 30 deg`, `3..7` if no angles name it."""
    if run.first == run.last:
        return index_text(bearings, run.first)
    angles = run_angles(bearings, run)
    return f"{run.first}..{run.last}" if angles is None else f"{angles[0]} deg .. {angles[1]} deg"


def run_angles(bearings: Bearings | None, run: Run) -> tuple[str, str] | None:
    """Return the angles of a slice that selects exactly a run; None if no such angles name it."""
    ends = naming_angle(bearings, run.first), naming_angle(bearings, run.last)
    if bearings is None or ends[0] is None or ends[1] is None:
        return None
    expected = _indices(run, len(bearings.angles))
    clockwise = (ends[1], ends[0])
    for low, high in ((ends[0], ends[1]), clockwise):
        selected = between(bearings, float(low), float(high))
        if len(selected) == len(expected) and set(selected) == expected:
            return low, high
    return None


def _commonest(values: tuple[ScalarValue, ...]) -> ScalarValue:
    [(common, _), *_] = Counter(values).most_common(1)
    return common


def _indices(run: Run, size: int) -> set[int]:
    if run.first <= run.last:
        return set(range(run.first, run.last + 1))
    return {*range(run.first, size), *range(run.last + 1)}


def _runs(
    values: tuple[ScalarValue, ...], common: tuple[ScalarValue, ...], bearings: Bearings | None
) -> tuple[Run, ...]:
    """Return the runs of equal elements that differ from `common`."""
    runs = list(_runs_by_index(values, common))
    if len(runs) < 2 or bearings is None:
        return tuple(runs)
    first, last = runs[0], runs[-1]
    joined = Run(last.first, first.last, first.value)
    meet = first.first == 0 and last.last == len(values) - 1 and first.value == last.value
    if meet and run_angles(bearings, joined) is not None:
        return (*runs[1:-1], joined)
    return tuple(runs)


def _runs_by_index(values: tuple[ScalarValue, ...], common: tuple[ScalarValue, ...]) -> Iterator[Run]:
    start: int | None = None
    for i, (value, other) in enumerate(zip(values, common, strict=True)):
        if start is not None and (value == other or value != values[start]):
            yield Run(start, i - 1, values[start])
            start = None
        if start is None and value != other:
            start = i
    if start is not None:
        yield Run(start, len(values) - 1, values[start])
