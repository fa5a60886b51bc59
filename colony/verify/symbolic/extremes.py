"""Extremes and elements of many numbers, as constants that are defined by axioms.

A chain of choices over hundreds of beams is a term as deep as they are many, which z3 explores one by one. An
axiom for each beam (the least number is at most this one) takes one comparison where a proof needs it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import reduce
from typing import cast

import z3

from colony.verify.symbolic.builder import Builder
from colony.verify.symbolic.cases import constant, hull
from colony.verify.symbolic.logic import FALSE, all_of, any_of, implied, integer, is_false, negation, pick
from colony.verify.symbolic.numbers import compared, select_number, whole_number
from colony.verify.symbolic.system import Bounds, Number, Operation, Scalar

MANY = 400
"""Number of values from which on they are bounded by axioms, not chosen one after the other.

Of fewer, as of a lidar with a beam a degree, the chain proves for floats what axioms prove for reals alone.
"""


def are_many(values: Sequence[object]) -> bool:
    """Return True if values are so many numbers of which none is known to be one of a few, or whole."""
    numbers = [x for x in values if isinstance(x, Number) and not x.cases]
    return len(numbers) > MANY and not all(x.bounds.whole for x in numbers)


def extreme_of_included(
    items: Sequence[tuple[Number, z3.BoolRef]], builder: Builder, *, least: bool
) -> Number:
    """Return the least, or greatest, of the included numbers; NaN if any is NaN, or there is none."""
    excluded = constant(math.inf if least else -math.inf)  # which never is the extreme of others
    found = extreme([select_number(c, x, excluded) for x, c in items], builder, least=least)
    nan = any_of((found.nan, negation(any_of(c for _, c in items))))
    if any(not is_false(x.infinite) for x, _ in items):
        return replace(found, nan=nan)
    bounds = replace(reduce(hull, (x.bounds for x, _ in items)), whole=False)
    return replace(found, nan=nan, infinite=FALSE, bounds=bounds)


def extreme(values: Sequence[Number], builder: Builder, *, least: bool) -> Number:
    """Return the least, or greatest, of many numbers; NaN if any is NaN."""
    nan = any_of(x.nan for x in values)
    low, high = _bounds([x.bounds for x in values], least=least)
    operation = Operation.LEAST if least else Operation.GREATEST
    value, is_new = builder.auxiliary(operation, tuple(values), z3.RealSort())
    infinite, subjects = FALSE, [value]
    if low is None or high is None:
        infinite = _infinite(values, builder, least=least)
        subjects += [] if is_false(infinite) else [infinite]
    found = Number(value, FALSE, infinite, Bounds(low, high))
    if is_new:
        axioms = [_ordered(found, x, least=least) for x in values]
        axioms.append(any_of(_ordered(x, found, least=least) for x in values))
        axioms.append(implied(infinite, cast(z3.BoolRef, z3.Or(value == 1, value == -1))))
        for subject in subjects:
            for axiom in axioms:
                builder.define(subject, implied(negation(nan), axiom))
    return Number(value, nan, infinite, found.bounds)


def _bounds(bounds: Sequence[Bounds], *, least: bool) -> tuple[Fraction | None, Fraction | None]:
    """Return the bounds of the least, or greatest, of numbers within these bounds."""
    lows, highs = [b.low for b in bounds], [b.high for b in bounds]
    known_lows, known_highs = [x for x in lows if x is not None], [x for x in highs if x is not None]
    if least:
        return (None if None in lows else min(known_lows)), min(known_highs, default=None)
    return max(known_lows, default=None), (None if None in highs else max(known_highs))


def _infinite(values: Sequence[Number], builder: Builder, *, least: bool) -> z3.BoolRef:
    """Return the condition that the extreme is infinite, as a constant."""
    if all(is_false(x.infinite) for x in values):
        return FALSE
    operation = Operation.LEAST_IS_INFINITE if least else Operation.GREATEST_IS_INFINITE
    return cast(z3.BoolRef, builder.auxiliary(operation, tuple(values), z3.BoolSort())[0])


def _ordered(x: Number, y: Number, *, least: bool) -> z3.BoolRef:
    return compared(x, y, "<=") if least else compared(y, x, "<=")


def index_of_extreme(
    values: Sequence[Number], indices: Sequence[int], builder: Builder, *, least: bool
) -> Number:
    """Return the index of the least, or greatest, of many numbers that are never NaN, the first among equals.

    `indices` are those of the values.
    """
    best = extreme(values, builder, least=least)
    operation = Operation.INDEX_OF_LEAST if least else Operation.INDEX_OF_GREATEST
    place, is_new = builder.auxiliary(operation, tuple(values), z3.IntSort())
    if is_new:
        builder.define(place, all_of((cast(z3.BoolRef, place >= 0), cast(z3.BoolRef, place < len(values)))))
        for k, x in enumerate(values):
            is_best = _ordered(x, best, least=least)
            builder.define(place, implied(cast(z3.BoolRef, place == k), is_best))
            builder.define(place, implied(is_best, cast(z3.BoolRef, place <= k)))
    offsets = [i - k for k, i in enumerate(indices)]
    index: z3.ArithRef = place + integer(offsets[-1]) if offsets[-1] else place
    for k in range(len(values) - 1, 0, -1):
        if offsets[k - 1] != offsets[k]:
            index = pick(cast(z3.BoolRef, place < k), place + integer(offsets[k - 1]), index)
    found = whole_number(index, Bounds(Fraction(min(indices)), Fraction(max(indices))))
    known = {i: builder.key(x) for i, x in zip(indices, values, strict=True)}
    builder.once(("extreme at", *builder.keep(index)), lambda: (known, best))
    return found


def extreme_at(array: Sequence[Scalar], index: Number, builder: Builder) -> Number | None:
    """Return the element of an array at an index that is that of its extreme, without a choice; else None."""
    if index.whole is None:
        return None
    known, best = builder.once(("extreme at", *builder.keep(index.whole)), lambda: ({}, None))
    is_same = best is not None and all(
        i < len(array) and builder.key(array[i]) == key for i, key in known.items()
    )
    return best if is_same else None
