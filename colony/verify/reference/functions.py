"""The pure functions and operators of the language on scalars, as the language reference defines them.

Every executor must give these results bit for bit, the sign of zero included, so each definition says what
happens at NaN, at infinities and at zeros. Nothing here raises on any float.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import assert_never

from colony.ir import angles
from colony.ir.expression import Binary, Function, Unary
from colony.ir.types import ScalarValue

NAN = math.nan


def unary(operator: Unary, x: ScalarValue) -> ScalarValue:
    """Return `-x`, `not x`."""
    match operator:
        case Unary.NEGATE:
            return -x
        case Unary.NOT:
            return not x
        case _:
            assert_never(operator)


def binary(operator: Binary, x: ScalarValue, y: ScalarValue) -> ScalarValue:
    """Return `x operator y`; both operands have been evaluated, whatever the operator."""
    match operator:
        case Binary.ADD:
            return x + y
        case Binary.SUBTRACT:
            return x - y
        case Binary.MULTIPLY:
            return x * y
        case Binary.DIVIDE:
            return divide(x, y)
        case Binary.LESS:
            return x < y
        case Binary.LESS_EQUAL:
            return x <= y
        case Binary.GREATER:
            return x > y
        case Binary.GREATER_EQUAL:
            return x >= y
        case Binary.EQUAL:
            return x == y
        case Binary.NOT_EQUAL:
            return x != y
        case Binary.AND:
            return x and y
        case Binary.OR:
            return x or y
        case Binary.IMPLIES:
            return not x or y
        case _:
            assert_never(operator)


def function(f: Function, x: Sequence[ScalarValue]) -> ScalarValue:
    """Return the value of `f` for `x`: the values to reduce, or the arguments in order."""
    match f:
        case Function.MIN:
            return least(x)
        case Function.MAX:
            return greatest(x)
        case Function.SUM:
            return total(x)
        case Function.MEAN:
            return total(x) / len(x) if x else NAN
        case Function.COUNT:
            return float(len([v for v in x if v]))
        case Function.ANY:
            return any(x)
        case Function.ALL:
            return all(x)
        case Function.INDEX_OF_MIN:
            return float(first_index(x, lambda a, b: a < b))
        case Function.INDEX_OF_MAX:
            return float(first_index(x, lambda a, b: a > b))
        case Function.MOD:
            return modulo(x[0], x[1])
        case Function.CLAMP:
            return least((greatest((x[0], x[1])), x[2]))
        case Function.ATAN2:
            return angles.direction(x[0], x[1])
        case Function.ANGLE_DIFFERENCE:
            return angle_difference(x[0], x[1])
        case _:
            return unary_function(f, x[0])


def unary_function(f: Function, x: float) -> float:
    """Return the value of a function of one number."""
    match f:
        case Function.ABS:
            return abs(x)
        case Function.SIGN:
            return x if math.isnan(x) else 1.0 if x > 0 else -1.0 if x < 0 else 0.0
        case Function.SQRT:
            return NAN if x < 0 else math.sqrt(x)
        case Function.FLOOR:
            return whole(math.floor, x)
        case Function.CEIL:
            return whole(math.ceil, x)
        case Function.ROUND:
            return whole(round, x)
        case Function.SIN:
            return angles.sine(x)
        case Function.COS:
            return angles.cosine(x)
        case Function.TAN:
            return angles.tangent(x)
        case Function.ASIN:
            return angles.arc_sine(x)
        case Function.ACOS:
            return angles.arc_cosine(x)
        case _:
            raise AssertionError(f"{f} is not a function of one number")


def divide(x: float, y: float) -> float:
    """Divide by IEEE 754: a division by zero gives an infinity, or NaN for 0 / 0 and NaN / 0."""
    if y != 0:
        return x / y
    if x == 0 or math.isnan(x):
        return NAN
    return math.copysign(1.0, x) * math.copysign(1.0, y) * math.inf


def modulo(x: float, y: float) -> float:
    """Return the remainder with the sign of `y`; NaN for y = 0."""
    return NAN if y == 0 else x % y


def angle_difference(a: float, b: float) -> float:
    """Return the angle from `b` to `a` in degrees: above -180, up to 180."""
    d = modulo(a - b, 360.0)
    return d - 360.0 if d > 180.0 else d


def least(x: Sequence[float]) -> float:
    """Return the least value, the first among equals; NaN if any is NaN, or there is none."""
    if not x or any(math.isnan(v) for v in x):
        return NAN
    best = x[0]
    for v in x:
        if v < best:
            best = v
    return best


def greatest(x: Sequence[float]) -> float:
    """Return the greatest value, the first among equals; NaN if any is NaN, or there is none."""
    if not x or any(math.isnan(v) for v in x):
        return NAN
    best = x[0]
    for v in x:
        if v > best:
            best = v
    return best


def total(x: Sequence[float]) -> float:
    """Return the sum from left to right, starting with the first value (a lone -0.0 stays); 0 of nothing."""
    if not x:
        return 0.0
    result = x[0]
    for v in x[1:]:
        result = result + v
    return result


def first_index(x: Sequence[float], better: Callable[[float, float], bool]) -> int:
    """Return the index of the best value, the first among equals; numbers beat NaN; 0 if all are NaN."""
    best = 0
    for i, v in enumerate(x):
        if better(v, x[best]) or (math.isnan(x[best]) and not math.isnan(v)):
            best = i
    return best


def whole(rounding: Callable[[float], int], x: float) -> float:
    """Return `x` rounded; a zero result has the sign of `x`; NaN and infinities are unchanged."""
    return math.copysign(float(rounding(x)), x) if math.isfinite(x) else x


def position(index: float, size: int, wraps: bool) -> int | None:
    """Return an index rounded (halves to even) and, if it `wraps`, taken modulo the size.

    None if it is outside, or not finite.
    """
    if not math.isfinite(index):
        return None
    place = round(index) % size if wraps else round(index)
    return place if 0 <= place < size else None


def element_at(array: tuple[ScalarValue, ...], index: float, wraps: bool) -> ScalarValue:
    """Return the element at `index`, see `position`; outside it is NaN, or False of an array of bools."""
    place = position(index, len(array), wraps)
    if place is None:
        return False if isinstance(array[0], bool) else NAN
    return array[place]
