"""Facts about nonlinear operations: intervals, signs, and linear bounds.

Every formula holds for the real result, for any operands within their bounds. So it can be assumed without
making a frame unsatisfiable. It also holds for the float that the program computes, unless it is marked as
holding only for reals: rounding is monotone, so it never leaves an interval whose ends are floats.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import cast

import z3

from colony.verify.symbolic.logic import all_of, any_of, both, either, implied, is_false, negation, real
from colony.verify.symbolic.numbers import always_finite, finite, negative_value, positive_value
from colony.verify.symbolic.system import UNBOUNDED, ExtendedReal, NumberBounds

NonlinearFact = tuple[z3.BoolRef, bool]
"""A formula, and True if it holds only for reals."""

_OVERFLOW_BOUND = Fraction(2**1023)


def never_overflows(x: NumberBounds) -> bool:
    """Return True if no number within the bounds overflows."""
    return (
        x.low is not None and x.high is not None and x.low >= -_OVERFLOW_BOUND and x.high <= _OVERFLOW_BOUND
    )


def float_bounds(x: NumberBounds) -> NumberBounds:
    """Return the bounds of a number within `x` after rounding; no bound where it may become infinite."""
    low = None if x.low is None or x.low < -_OVERFLOW_BOUND else _nearest(x.low)
    high = None if x.high is None or x.high > _OVERFLOW_BOUND else _nearest(x.high)
    return NumberBounds(low, high, x.whole)


def _nearest(x: Fraction) -> Fraction:
    return Fraction(float(min(max(x, -_OVERFLOW_BOUND), _OVERFLOW_BOUND)))


def rounded(x: NumberBounds) -> NumberBounds:
    """Return bounds that hold for a number within `x` both before and after rounding."""
    after = float_bounds(x)
    low = None if after.low is None or x.low is None else min(x.low, after.low)
    high = None if after.high is None or x.high is None else max(x.high, after.high)
    return NumberBounds(low, high, x.whole)


def product(x: NumberBounds, y: NumberBounds) -> NumberBounds:
    """Return the bounds of a product."""
    if None in (x.low, x.high, y.low, y.high):
        positive = _at_least_zero(x) and _at_least_zero(y)
        return NumberBounds(Fraction(0) if positive else None, None)
    ends = [a * b for a in _ends(x) for b in _ends(y)]
    return NumberBounds(min(ends), max(ends))


def _at_least_zero(x: NumberBounds) -> bool:
    return x.low is not None and x.low >= 0


def _ends(x: NumberBounds) -> tuple[Fraction, Fraction]:
    assert x.low is not None
    assert x.high is not None
    return x.low, x.high


def quotient(x: NumberBounds, y: NumberBounds) -> NumberBounds:
    """Return the bounds of a quotient of finite numbers; unbounded if the divisor may be 0."""
    if y.low is not None and y.low > 0:
        inverse = NumberBounds(Fraction(0) if y.high is None else 1 / y.high, 1 / y.low)
    elif y.high is not None and y.high < 0:
        inverse = NumberBounds(1 / y.high, Fraction(0) if y.low is None else 1 / y.low)
    else:
        return UNBOUNDED
    return product(x, inverse)


def modulo(y: NumberBounds) -> NumberBounds:
    """Return the bounds of a remainder by `y`: between 0 and `y`."""
    low = None if y.low is None else min(y.low, Fraction(0))
    high = None if y.high is None else max(y.high, Fraction(0))
    return NumberBounds(low, high)


def square_root(x: NumberBounds) -> NumberBounds:
    """Return rough bounds of a square root."""
    high = None if x.high is None else _root_above(x.high)
    return NumberBounds(Fraction(0), high)


def _root_above(x: Fraction) -> Fraction:
    """Return an upper bound of the root, also after rounding."""
    return Fraction(math.nextafter(math.sqrt(float(max(x, Fraction(0)))), math.inf)) if x < 10**300 else x


def arc_tangent(y: ExtendedReal, x: ExtendedReal) -> NumberBounds:
    """Return the bounds of `atan2(y, x)` from the sign of `y`; -0.0 may count as below 0."""
    half = 90 if x.bounds.low is not None and x.bounds.low > 0 else 180
    low = 0 if y.bounds.low is not None and y.bounds.low > 0 else -half
    high = 0 if y.bounds.high is not None and y.bounds.high < 0 else half
    return NumberBounds(Fraction(low), Fraction(high))


def floor_bounds(x: NumberBounds) -> tuple[int | None, int | None]:
    """Return the bounds of the floor."""
    return (
        None if x.low is None else math.floor(x.low),
        None if x.high is None else math.floor(x.high),
    )


def round_bounds(x: NumberBounds) -> tuple[int | None, int | None]:
    """Return the bounds of the nearest whole number, halves to even."""
    return None if x.low is None else round(x.low), None if x.high is None else round(x.high)


# --- assumptions ---------------------------------------------------------------------------------


def between(term: z3.ArithRef, bounds: NumberBounds) -> Iterator[z3.BoolRef]:
    """Yield the conditions that a term is within bounds."""
    if bounds.low is not None:
        yield cast(z3.BoolRef, term >= real(bounds.low))
    if bounds.high is not None:
        yield cast(z3.BoolRef, term <= real(bounds.high))


def within(x: ExtendedReal, bounds: NumberBounds) -> z3.BoolRef:
    """Return the condition that `x` is within `bounds` if it is finite."""
    inside = all_of(between(x.value, bounds))
    return inside if always_finite(x) else implied(finite(x), inside)


def _is_zero(x: ExtendedReal) -> z3.BoolRef:
    return negation(either(positive_value(x), negative_value(x)))


def _sign_rules(p: z3.ArithRef, x: ExtendedReal, y: ExtendedReal) -> Iterator[z3.BoolRef]:
    """Yield rules for the sign of a product or quotient; small ones may round to 0."""
    same_sign = either(both(positive_value(x), positive_value(y)), both(negative_value(x), negative_value(y)))
    opposite_sign = either(
        both(positive_value(x), negative_value(y)), both(negative_value(x), positive_value(y))
    )
    yield implied(same_sign, cast(z3.BoolRef, p >= 0))
    yield implied(opposite_sign, cast(z3.BoolRef, p <= 0))


def product_facts(
    p: z3.ArithRef, x: ExtendedReal, y: ExtendedReal, bounds: NumberBounds
) -> Iterator[NonlinearFact]:
    """Yield facts about a product: its sign, zero operands, and linear bounds."""
    both_finite = both(finite(x), finite(y))
    rules = [*_sign_rules(p, x, y), implied(either(_is_zero(x), _is_zero(y)), cast(z3.BoolRef, p == 0))]
    for formula in (*rules, *between(p, rounded(bounds))):
        yield implied(both_finite, formula), False
    for formula in _envelope(p, x, y):
        yield implied(both_finite, formula), True
    if not (always_finite(x) and always_finite(y)):
        for formula in _infinite_sign(p, x, y):
            yield formula, False


def _infinite_sign(p: z3.ArithRef, x: ExtendedReal, y: ExtendedReal) -> Iterator[z3.BoolRef]:
    """Yield rules for the sign of an infinite result, from the signs of its operands."""
    infinite = either(x.infinite, y.infinite)
    same_sign = either(both(positive_value(x), positive_value(y)), both(negative_value(x), negative_value(y)))
    opposite_sign = either(
        both(positive_value(x), negative_value(y)), both(negative_value(x), positive_value(y))
    )
    yield implied(both(infinite, same_sign), cast(z3.BoolRef, p > 0))
    yield implied(both(infinite, opposite_sign), cast(z3.BoolRef, p < 0))


def _envelope(p: z3.ArithRef, x: ExtendedReal, y: ExtendedReal) -> Iterator[z3.BoolRef]:
    """Yield McCormick's linear bounds of a product, one for each pair of interval ends."""
    v, w, a, b = x.value, y.value, x.bounds, y.bounds
    for s, t, below in (
        (a.low, b.low, True),
        (a.high, b.high, True),
        (a.low, b.high, False),
        (a.high, b.low, False),
    ):
        if s is not None and t is not None:
            plane = real(s) * w + real(t) * v - real(s * t)
            yield cast(z3.BoolRef, p >= plane if below else p <= plane)


def quotient_facts(
    q: z3.ArithRef,
    x: ExtendedReal,
    y: ExtendedReal,
    by_zero: z3.BoolRef,
    nan: z3.BoolRef,
    bounds: NumberBounds,
    precise: bool,
) -> Iterator[NonlinearFact]:
    """Yield facts about a quotient: its sign and bounds; division by zero gives either infinity."""
    is_ordinary = all_of((finite(x), finite(y), negation(by_zero)))
    rules = [*_sign_rules(q, x, y), implied(_is_zero(x), cast(z3.BoolRef, q == 0))]
    for formula in (*rules, *between(q, rounded(bounds))):
        yield implied(is_ordinary, formula), False
    for formula in _linear_quotient(q, x, y):
        yield implied(is_ordinary, formula), True
    if precise:
        yield implied(is_ordinary, cast(z3.BoolRef, q * y.value == x.value)), True
    yield implied(both(by_zero, negation(nan)), cast(z3.BoolRef, q != 0)), False
    if not is_false(x.infinite):
        divided = both(x.infinite, negation(either(by_zero, y.infinite)))
        for formula in _infinite_sign(q, x, y):
            yield implied(divided, formula), False
    if not is_false(y.infinite):
        yield implied(both(finite(x), y.infinite), cast(z3.BoolRef, q == 0)), False


def _linear_quotient(q: z3.ArithRef, x: ExtendedReal, y: ExtendedReal) -> Iterator[z3.BoolRef]:
    """Yield linear bounds of a quotient by a positive divisor: the dividend over each end of the divisor."""
    low, high = y.bounds.low, y.bounds.high
    if low is None or low <= 0:
        return
    up, down = positive_value(x), negative_value(x)
    nearest = x.value * real(1 / low)
    yield implied(up, cast(z3.BoolRef, q <= nearest))
    yield implied(down, cast(z3.BoolRef, q >= nearest))
    if high is not None:
        farthest = x.value * real(1 / high)
        yield implied(up, cast(z3.BoolRef, q >= farthest))
        yield implied(down, cast(z3.BoolRef, q <= farthest))


def modulo_facts(
    r: z3.ArithRef, x: ExtendedReal, y: ExtendedReal, nan: z3.BoolRef
) -> Iterator[NonlinearFact]:
    """Yield facts about a remainder: it is between 0 and the divisor.

    A remainder by infinity is the dividend, or the divisor if their signs are opposite.
    """
    is_number = negation(nan)
    is_ordinary = both(is_number, negation(y.infinite))
    yield implied(both(is_ordinary, positive_value(y)), all_of(map(_bool, (r >= 0, r <= y.value)))), False
    yield implied(both(is_ordinary, negative_value(y)), all_of(map(_bool, (r <= 0, r >= y.value)))), False
    if not is_false(y.infinite):
        opposite_signs = either(
            both(positive_value(x), negative_value(y)), both(negative_value(x), positive_value(y))
        )
        by_infinity = both(is_number, y.infinite)
        yield implied(both(by_infinity, opposite_signs), has_sign_of(r, y)), False
        yield implied(both(by_infinity, negation(opposite_signs)), _bool(r == x.value)), False


def has_sign_of(r: z3.ArithRef, y: ExtendedReal) -> z3.BoolRef:
    """Return the condition that `r` has the sign of `y`."""
    return any_of((both(positive_value(y), _bool(r > 0)), both(negative_value(y), _bool(r < 0))))


def _bool(formula: object) -> z3.BoolRef:
    return cast(z3.BoolRef, formula)


def square_root_facts(r: z3.ArithRef, x: ExtendedReal, nan: z3.BoolRef) -> Iterator[NonlinearFact]:
    """Yield facts about a square root: at least 0, and between 1 and the operand."""
    is_number = negation(nan)
    yield implied(is_number, _bool(r >= 0)), False
    yield implied(both(is_number, _bool(x.value > 0)), _bool(r > 0)), False
    finite_root = both(is_number, negation(x.infinite))
    yield implied(both(finite_root, _bool(x.value <= 1)), all_of(map(_bool, (r >= x.value, r <= 1)))), False
    yield implied(both(finite_root, _bool(x.value >= 1)), all_of(map(_bool, (r <= x.value, r >= 1)))), False
    high = square_root(x.bounds).high
    if high is not None:
        yield implied(finite_root, _bool(r <= real(high))), False


def arc_tangent_facts(r: z3.ArithRef, y: ExtendedReal, x: ExtendedReal) -> Iterator[z3.BoolRef]:
    """Yield facts about an angle: its quadrant, in some cases its octant; the sign of zero is unknown."""
    yield all_of(map(_bool, (r >= -180, r <= 180)))
    yield implied(positive_value(y), _bool(r >= 0))
    yield implied(negative_value(y), _bool(r <= 0))
    steep = z3.Or(r == 90, r == -90)
    yield implied(both(_is_zero(y), positive_value(x)), _bool(r == 0))
    yield implied(both(_is_zero(y), negative_value(x)), _bool(z3.Or(r == 180, r == -180)))
    yield implied(both(_is_zero(y), _is_zero(x)), _bool(r == 0))
    yield implied(both(negation(_is_zero(y)), _is_zero(x)), steep)
    yield implied(positive_value(x), all_of(map(_bool, (r >= -90, r <= 90))))
    yield implied(negative_value(x), any_of(map(_bool, (r >= 90, r <= -90))))
    if always_finite(x) and always_finite(y):
        shallow = all_of(map(_bool, (x.value > 0, y.value <= x.value, -x.value <= y.value)))
        yield implied(shallow, all_of(map(_bool, (r >= -45, r <= 45))))
