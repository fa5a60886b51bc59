"""The pure functions of the language on terms, as the language reference defines them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import reduce
from typing import assert_never, cast

import z3

from colony.ir.expression import REDUCTIONS, Binary, Function, Unary
from colony.verify.symbolic.arithmetic import Arithmetic
from colony.verify.symbolic.builder import SystemBuilder
from colony.verify.symbolic.cases import by_cases, constant, constant_of, hull
from colony.verify.symbolic.logic import (
    FALSE,
    TRUE,
    all_of,
    any_of,
    both,
    either,
    equivalent,
    implied,
    integer,
    is_false,
    negation,
    pick,
)
from colony.verify.symbolic.numbers import (
    compared,
    equal,
    greatest,
    least,
    negated,
    select_number,
    whole_number,
)
from colony.verify.symbolic.system import ExtendedReal, NumberBounds, Operation, Scalar

# --- extremes -----------------------------------------------------------------------------------------
#
# Extremes and elements of many numbers, as constants that are defined by axioms.
#
# A chain of choices over hundreds of beams is a term as deep as they are many, which z3 explores one by one.
# An axiom for each beam (the least number is at most this one) takes one comparison where a proof needs it.

MANY = 400
"""Number of values from which on they are bounded by axioms, not chosen one after the other.

Of fewer, as of a lidar with a beam a degree, the chain proves for floats what axioms prove for reals alone.
"""


def are_many(values: Sequence[object]) -> bool:
    """Return True if values are so many numbers of which none is known to be one of a few, or whole."""
    numbers = [x for x in values if isinstance(x, ExtendedReal) and not x.cases]
    return len(numbers) > MANY and not all(x.bounds.whole for x in numbers)


def extreme_of_included(
    items: Sequence[tuple[ExtendedReal, z3.BoolRef]], builder: SystemBuilder, *, least: bool
) -> ExtendedReal:
    """Return the least, or greatest, of the included numbers; NaN if any is NaN, or there is none."""
    excluded = constant(math.inf if least else -math.inf)  # which never is the extreme of others
    found = extreme([select_number(c, x, excluded) for x, c in items], builder, least=least)
    nan = any_of((found.nan, negation(any_of(c for _, c in items))))
    if any(not is_false(x.infinite) for x, _ in items):
        return replace(found, nan=nan)
    bounds = replace(reduce(hull, (x.bounds for x, _ in items)), whole=False)
    return replace(found, nan=nan, infinite=FALSE, bounds=bounds)


def extreme(values: Sequence[ExtendedReal], builder: SystemBuilder, *, least: bool) -> ExtendedReal:
    """Return the least, or greatest, of many numbers; NaN if any is NaN."""
    nan = any_of(x.nan for x in values)
    low, high = _bounds([x.bounds for x in values], least=least)
    operation = Operation.LEAST if least else Operation.GREATEST
    value, is_new = builder.auxiliary(operation, tuple(values), z3.RealSort())
    infinite, subjects = FALSE, [value]
    if low is None or high is None:
        infinite = _infinite(values, builder, least=least)
        subjects += [] if is_false(infinite) else [infinite]
    found = ExtendedReal(value, FALSE, infinite, NumberBounds(low, high))
    if is_new:
        axioms = [_ordered(found, x, least=least) for x in values]
        axioms.append(any_of(_ordered(x, found, least=least) for x in values))
        axioms.append(implied(infinite, cast(z3.BoolRef, z3.Or(value == 1, value == -1))))
        for subject in subjects:
            for axiom in axioms:
                builder.define(subject, implied(negation(nan), axiom))
    return ExtendedReal(value, nan, infinite, found.bounds)


def _bounds(bounds: Sequence[NumberBounds], *, least: bool) -> tuple[Fraction | None, Fraction | None]:
    """Return the bounds of the least, or greatest, of numbers within these bounds."""
    lows, highs = [b.low for b in bounds], [b.high for b in bounds]
    known_lows, known_highs = [x for x in lows if x is not None], [x for x in highs if x is not None]
    if least:
        return (None if None in lows else min(known_lows)), min(known_highs, default=None)
    return max(known_lows, default=None), (None if None in highs else max(known_highs))


def _infinite(values: Sequence[ExtendedReal], builder: SystemBuilder, *, least: bool) -> z3.BoolRef:
    """Return the condition that the extreme is infinite, as a constant."""
    if all(is_false(x.infinite) for x in values):
        return FALSE
    operation = Operation.LEAST_IS_INFINITE if least else Operation.GREATEST_IS_INFINITE
    return cast(z3.BoolRef, builder.auxiliary(operation, tuple(values), z3.BoolSort())[0])


def _ordered(x: ExtendedReal, y: ExtendedReal, *, least: bool) -> z3.BoolRef:
    return compared(x, y, "<=") if least else compared(y, x, "<=")


def index_of_extreme(
    values: Sequence[ExtendedReal], indices: Sequence[int], builder: SystemBuilder, *, least: bool
) -> ExtendedReal:
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
    found = whole_number(index, NumberBounds(Fraction(min(indices)), Fraction(max(indices))))
    known = {i: builder.key(x) for i, x in zip(indices, values, strict=True)}
    builder.once(("extreme at", *builder.keep(index)), lambda: (known, best))
    return found


def extreme_at(array: Sequence[Scalar], index: ExtendedReal, builder: SystemBuilder) -> ExtendedReal | None:
    """Return the element of an array at an index that is that of its extreme, without a choice; else None."""
    if index.whole is None:
        return None
    known, best = builder.once(("extreme at", *builder.keep(index.whole)), lambda: ({}, None))
    is_same = best is not None and all(
        i < len(array) and builder.key(array[i]) == key for i, key in known.items()
    )
    return best if is_same else None


# --- functions ----------------------------------------------------------------------------------------

ReductionItem = tuple[Scalar, z3.BoolRef]
"""A value of a reduction, and the condition that it is included."""


def number(x: Scalar) -> ExtendedReal:
    """Return a scalar that is a number."""
    assert isinstance(x, ExtendedReal)
    return x


def boolean(x: Scalar) -> z3.BoolRef:
    """Return a scalar that is a condition."""
    assert not isinstance(x, ExtendedReal)
    return x


def unary(operator: Unary, x: Scalar) -> Scalar:
    """Return `-x`, `not x`."""
    match operator:
        case Unary.NEGATE:
            return negated(number(x))
        case Unary.NOT:
            return negation(boolean(x))
        case _:
            assert_never(operator)


def binary(operator: Binary, x: Scalar, y: Scalar, arithmetic: Arithmetic) -> Scalar:
    """Return `x operator y`."""
    match operator:
        case Binary.ADD:
            return arithmetic.add(number(x), number(y))
        case Binary.SUBTRACT:
            return arithmetic.subtract(number(x), number(y))
        case Binary.MULTIPLY:
            return arithmetic.multiply(number(x), number(y))
        case Binary.DIVIDE:
            return arithmetic.divide(number(x), number(y))
        case _:
            return relation(operator, x, y)


def relation(operator: Binary, x: Scalar, y: Scalar) -> z3.BoolRef:
    """Return the result of an operator that gives a truth value."""
    match operator:
        case Binary.LESS:
            return compared(number(x), number(y), "<")
        case Binary.LESS_EQUAL:
            return compared(number(x), number(y), "<=")
        case Binary.GREATER:
            return compared(number(y), number(x), "<")
        case Binary.GREATER_EQUAL:
            return compared(number(y), number(x), "<=")
        case Binary.EQUAL:
            return _equal(x, y)
        case Binary.NOT_EQUAL:
            return negation(_equal(x, y))
        case Binary.AND:
            return both(boolean(x), boolean(y))
        case Binary.OR:
            return either(boolean(x), boolean(y))
        case Binary.IMPLIES:
            return implied(boolean(x), boolean(y))
        case _:
            raise AssertionError(f"`{operator.value}` gives no truth value")


def _equal(x: Scalar, y: Scalar) -> z3.BoolRef:
    return equal(x, y) if isinstance(x, ExtendedReal) else equivalent(x, boolean(y))


def apply(function: Function, x: Sequence[Scalar], arithmetic: Arithmetic) -> Scalar:
    """Return `function` applied to `x`: the values to reduce, or the arguments in order."""
    match function:
        case Function.CLAMP:
            return arithmetic.clamp(number(x[0]), number(x[1]), number(x[2]))
        case Function.MOD:
            return arithmetic.modulo(number(x[0]), number(x[1]))
        case Function.ATAN2:
            return arithmetic.arc_tangent(number(x[0]), number(x[1]))
        case Function.ANGLE_DIFFERENCE:
            return arithmetic.angle_difference(number(x[0]), number(x[1]))
        case Function.INDEX_OF_MIN | Function.INDEX_OF_MAX:
            numbers = [number(v) for v in x]
            return index_of(function, numbers, [constant(float(i)) for i in range(len(x))], arithmetic)
        case _ if function in REDUCTIONS:
            return reduction(function, [(v, TRUE) for v in x], arithmetic)
        case _:
            return _unary_function(function, number(x[0]), arithmetic)


def _unary_function(function: Function, x: ExtendedReal, arithmetic: Arithmetic) -> ExtendedReal:
    match function:
        case Function.ABS:
            return arithmetic.absolute(x)
        case Function.SIGN:
            return arithmetic.sign(x)
        case Function.SQRT:
            return arithmetic.square_root(x)
        case Function.FLOOR:
            return arithmetic.floor(x)
        case Function.CEIL:
            return arithmetic.ceil(x)
        case Function.ROUND:
            return arithmetic.round(x)
        case Function.TAN:
            return arithmetic.tangent(x)
        case Function.ASIN | Function.ACOS:
            return arithmetic.arc_sine(x, function)
        case _:
            return arithmetic.sine(x, function)


# --- reductions ----------------------------------------------------------------------------------


def reduction(function: Function, items: Sequence[ReductionItem], arithmetic: Arithmetic) -> Scalar:
    """Return `function` applied to the values that are included."""
    included = [(x, condition) for x, condition in items if not is_false(condition)]
    match function:
        case Function.ANY:
            return any_of(both(boolean(x), c) for x, c in included)
        case Function.ALL:
            return all_of(implied(c, boolean(x)) for x, c in included)
        case Function.COUNT:
            return count([both(boolean(x), c) for x, c in included], arithmetic)
        case Function.SUM:
            return _total([(number(x), c) for x, c in included], arithmetic)
        case Function.MEAN:
            numbers = [(number(x), c) for x, c in included]
            return arithmetic.divide(_total(numbers, arithmetic), count([c for _, c in included], arithmetic))
        case Function.MIN | Function.MAX:
            return _best(function, [(number(x), c) for x, c in included], arithmetic)
        case _:
            raise AssertionError(f"{function.value} is not a reduction")


def count(truths: Sequence[z3.BoolRef], arithmetic: Arithmetic) -> ExtendedReal:
    """Return the number of true conditions, by cases if they are few."""
    total = constant(0.0)
    for b in truths:
        total = arithmetic.add(total, by_cases(((1.0, b), (0.0, negation(b)))))
    return total


def _total(items: Sequence[tuple[ExtendedReal, z3.BoolRef]], arithmetic: Arithmetic) -> ExtendedReal:
    """Return the sum from left to right, starting with the first value (a lone -0.0 stays); 0 of nothing."""
    total = constant(-0.0)  # the neutral element of addition, even for -0.0
    for i, (x, condition) in enumerate(items):
        added = x if i == 0 else arithmetic.add(total, x)
        total = select_number(condition, added, total)
    if not total.cases:
        return total  # its zeros may have either sign
    return select_number(any_of(condition for _, condition in items), total, constant(0.0))


def _best(
    function: Function, items: Sequence[tuple[ExtendedReal, z3.BoolRef]], arithmetic: Arithmetic
) -> ExtendedReal:
    """Return the least or greatest value; NaN if any is NaN, or there is none."""
    if are_many([x for x, _ in items]):
        return extreme_of_included(items, arithmetic.builder, least=function is Function.MIN)
    choose = least if function is Function.MIN else greatest
    best, any_included = constant(math.nan), FALSE
    for x, condition in items:
        candidate = choose((best, x)) if not is_false(any_included) else x
        candidate = select_number(any_included, candidate, x)
        best, any_included = select_number(condition, candidate, best), either(any_included, condition)
    return best


def index_of(
    function: Function,
    values: Sequence[ExtendedReal],
    indices: Sequence[ExtendedReal],
    arithmetic: Arithmetic,
) -> ExtendedReal:
    """Return the index of the least or greatest value, the first among equals; any number beats NaN."""
    found = (constant_of(x) for x in indices)
    constants = [int(c) for c in found if c is not None and math.isfinite(c)]
    if are_many(values) and len(constants) == len(indices) and all(is_false(x.nan) for x in values):
        is_least = function is Function.INDEX_OF_MIN
        return index_of_extreme(values, constants, arithmetic.builder, least=is_least)
    best, index = values[0], indices[0]
    for x, i in zip(values[1:], indices[1:], strict=True):
        beats = compared(x, best, "<") if function is Function.INDEX_OF_MIN else compared(best, x, "<")
        better = either(beats, both(best.nan, negation(x.nan)))
        best, index = select_number(better, x, best), select_number(better, i, index)
    return index
