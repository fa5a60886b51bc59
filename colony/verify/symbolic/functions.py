"""The pure functions of the language on terms, as the language reference defines them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import assert_never

import z3

from colony.ir.expression import REDUCTIONS, Binary, Function, Unary
from colony.verify.symbolic.arithmetic import Arithmetic
from colony.verify.symbolic.cases import by_cases, constant, constant_of
from colony.verify.symbolic.extremes import are_many, extreme_of_included, index_of_extreme
from colony.verify.symbolic.logic import (
    FALSE,
    TRUE,
    all_of,
    any_of,
    both,
    either,
    equivalent,
    implied,
    is_false,
    negation,
)
from colony.verify.symbolic.numbers import compared, equal, greatest, least, negated, select_number
from colony.verify.symbolic.system import Number, Scalar

ReductionItem = tuple[Scalar, z3.BoolRef]
"""A value of a reduction, and the condition that it is included."""


def number(x: Scalar) -> Number:
    """Return a scalar that is a number."""
    assert isinstance(x, Number)
    return x


def boolean(x: Scalar) -> z3.BoolRef:
    """Return a scalar that is a condition."""
    assert not isinstance(x, Number)
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
    return equal(x, y) if isinstance(x, Number) else equivalent(x, boolean(y))


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


def _unary_function(function: Function, x: Number, arithmetic: Arithmetic) -> Number:
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


def count(truths: Sequence[z3.BoolRef], arithmetic: Arithmetic) -> Number:
    """Return the number of true conditions, by cases if they are few."""
    total = constant(0.0)
    for b in truths:
        total = arithmetic.add(total, by_cases(((1.0, b), (0.0, negation(b)))))
    return total


def _total(items: Sequence[tuple[Number, z3.BoolRef]], arithmetic: Arithmetic) -> Number:
    """Return the sum from left to right, starting with the first value (a lone -0.0 stays); 0 of nothing."""
    total = constant(-0.0)  # the neutral element of addition, even for -0.0
    for i, (x, condition) in enumerate(items):
        added = x if i == 0 else arithmetic.add(total, x)
        total = select_number(condition, added, total)
    if not total.cases:
        return total  # its zeros may have either sign
    return select_number(any_of(condition for _, condition in items), total, constant(0.0))


def _best(function: Function, items: Sequence[tuple[Number, z3.BoolRef]], arithmetic: Arithmetic) -> Number:
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
    function: Function, values: Sequence[Number], indices: Sequence[Number], arithmetic: Arithmetic
) -> Number:
    """Return the index of the least or greatest value, the first among equals; any number beats NaN."""
    constants = [int(c) for x in indices if (c := constant_of(x)) is not None]
    if are_many(values) and len(constants) == len(indices) and all(is_false(x.nan) for x in values):
        is_least = function is Function.INDEX_OF_MIN
        return index_of_extreme(values, constants, arithmetic.builder, least=is_least)
    best, index = values[0], indices[0]
    for x, i in zip(values[1:], indices[1:], strict=True):
        beats = compared(x, best, "<") if function is Function.INDEX_OF_MIN else compared(best, x, "<")
        better = either(beats, both(best.nan, negation(x.nan)))
        best, index = select_number(better, x, best), select_number(better, i, index)
    return index
