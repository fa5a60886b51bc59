"""Operations on extended reals that need no new constants.

They are comparisons, choices, sums, minimum and maximum: linear arithmetic, plus NaN and the infinities.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import reduce
from typing import cast

import z3

from colony.verify.symbolic.cases import (
    MAX_CASES,
    by_cases,
    case_results,
    constant,
    constant_of,
    fold,
    hull,
    whole_of,
)
from colony.verify.symbolic.logic import (
    FALSE,
    TRUE,
    all_of,
    any_of,
    both,
    choice,
    either,
    integer,
    is_false,
    is_true,
    negation,
    pick,
    real,
    same,
)
from colony.verify.symbolic.system import UNBOUNDED, ExtendedReal, NumberBounds, Scalar

# --- thresholds ---------------------------------------------------------------------------------------
#
# Exact comparison of times with constants.
#
# A time is nanoseconds / 1e9, rounded. As rounding is monotone, comparing a time with a constant is the same
# as comparing its nanoseconds with a threshold, which a binary search finds.

_MAX_SECONDS = 1e12  # longer than any program waits, and far from overflow


def compared_time(x: ExtendedReal, y: ExtendedReal, relation: str) -> z3.BoolRef | None:
    """Return `x relation y` (`<`, `<=`, `==`) of a time and a constant in either order; None for others."""
    if x.nanoseconds is not None and _are_moderate_constants(y):
        time = x.nanoseconds
        return any_of(both(condition, _time_on_left(time, v, relation)) for v, condition in y.cases)
    if y.nanoseconds is not None and _are_moderate_constants(x):
        time = y.nanoseconds
        return any_of(both(condition, _time_on_right(time, v, relation)) for v, condition in x.cases)
    return None


def _are_moderate_constants(x: ExtendedReal) -> bool:
    return bool(x.cases) and all(abs(v) <= _MAX_SECONDS for v, _ in x.cases)


def _time_on_left(time: z3.ArithRef, constant: float, relation: str) -> z3.BoolRef:
    """Return `time relation constant`."""
    match relation:
        case "<":
            return negation(_reaches(time, constant))
        case "<=":
            return negation(_exceeds(time, constant))
        case _:
            return both(_reaches(time, constant), negation(_exceeds(time, constant)))


def _time_on_right(time: z3.ArithRef, constant: float, relation: str) -> z3.BoolRef:
    """Return `constant relation time`."""
    match relation:
        case "<":
            return _exceeds(time, constant)
        case "<=":
            return _reaches(time, constant)
        case _:
            return _time_on_left(time, constant, relation)


def _reaches(time: z3.ArithRef, constant: float) -> z3.BoolRef:
    """Return the condition that a time is `constant` or more."""
    return _at_least(time, first_ns_reaching(constant))


def _exceeds(time: z3.ArithRef, constant: float) -> z3.BoolRef:
    """Return the condition that a time is more than `constant`."""
    return _at_least(time, first_ns_reaching(math.nextafter(constant, math.inf)))


def _at_least(time: z3.ArithRef, nanoseconds: int) -> z3.BoolRef:
    return TRUE if nanoseconds <= 0 else cast(z3.BoolRef, time >= integer(nanoseconds))


def first_ns_reaching(constant: float) -> int:
    """Return the least number of nanoseconds, at least 0, that is `constant` seconds or more as a float."""
    low, high = -1, 1
    while high / 1e9 < constant:
        high *= 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if middle / 1e9 >= constant else (middle, high)
    return high


# --- numbers ------------------------------------------------------------------------------------------

EXACT_WHOLE = Fraction(2**53)
"""All integers up to this bound are floats, so their sums are exact."""


def whole_number(term: z3.ArithRef, bounds: NumberBounds = UNBOUNDED) -> ExtendedReal:
    """Return a term of sort Int as a number."""
    return ExtendedReal(z3.ToReal(term), FALSE, FALSE, replace(bounds, whole=True), term)


def finite(x: ExtendedReal) -> z3.BoolRef:
    """Return the condition that `x` is neither NaN nor infinite."""
    return negation(either(x.nan, x.infinite))


def always_finite(x: ExtendedReal) -> bool:
    """Return True if `x` is known to be finite in every run."""
    return is_false(x.nan) and is_false(x.infinite)


# --- bounds --------------------------------------------------------------------------------------


def hull_of(x: ExtendedReal, y: ExtendedReal) -> NumberBounds:
    """Return bounds that contain both numbers; a number that is always NaN does not count."""
    if is_true(x.nan):
        return y.bounds
    if is_true(y.nan):
        return x.bounds
    return hull(x.bounds, y.bounds)


def changed_bounds(x: ExtendedReal, old: ExtendedReal) -> NumberBounds | None:
    """Return the bounds of `x` where it differs from `old`; None if it never does."""
    return _changed_bounds(x, old, {})


def _changed_bounds(
    x: ExtendedReal, old: ExtendedReal, known: dict[int, NumberBounds | None]
) -> NumberBounds | None:
    """Return `changed_bounds`; `known` has those of branches, which many choices may share."""
    if id(x) in known:
        return known[id(x)]
    found: NumberBounds | None = None
    if not same(x.value, old.value):
        branch_bounds = [_changed_bounds(branch, old, known) for branch in x.branches]
        changed = [bounds for bounds in branch_bounds if bounds is not None]
        found = x.bounds if len(changed) == len(branch_bounds) else reduce(hull, changed) if changed else None
    known[id(x)] = found
    return found


def is_exact_whole(bounds: NumberBounds) -> bool:
    """Return True if all numbers within the bounds are integers that floats represent exactly."""
    if not bounds.whole or bounds.low is None or bounds.high is None:
        return False
    return bounds.low >= -EXACT_WHOLE and bounds.high <= EXACT_WHOLE


# --- comparisons ---------------------------------------------------------------------------------


def compared(x: ExtendedReal, y: ExtendedReal, relation: str) -> z3.BoolRef:
    """Return `x relation y` for `<`, `<=`, `==`; false if one is NaN."""
    rows = case_results(_RELATIONS[relation], (x, y))
    if rows:
        return any_of(condition for holds, condition in rows if holds)
    no_nan = negation(either(x.nan, y.nan))
    result = compared_time(x, y, relation)
    if result is None:
        result = _decided_by_bounds(x, y, relation)
    if result is not None:
        return both(no_nan, result)
    result = _finite_comparison(x, y, relation)
    for a, b, swapped in ((y, x, True), (x, y, False)):
        if not is_false(a.infinite):
            result = choice(a.infinite, _infinite_comparison(a, b, relation, swapped), result)
    return both(no_nan, result)


_RELATIONS: dict[str, Callable[[float, float], bool]] = {
    "<": lambda x, y: x < y,
    "<=": lambda x, y: x <= y,
    "==": lambda x, y: x == y,
}


def _decided_by_bounds(x: ExtendedReal, y: ExtendedReal, relation: str) -> z3.BoolRef | None:
    """Return the relation of two numbers that are not NaN if their bounds decide it, else None."""
    a, b = x.bounds, y.bounds
    below = a.high is not None and b.low is not None and a.high < b.low
    above = a.low is not None and b.high is not None and a.low > b.high
    match relation:
        case "==":
            return FALSE if below or above else None
        case "<":
            never = a.low is not None and b.high is not None and a.low >= b.high
            return TRUE if below else FALSE if never else None
        case _:
            always = a.high is not None and b.low is not None and a.high <= b.low
            return TRUE if always else FALSE if above else None


def _finite_comparison(x: ExtendedReal, y: ExtendedReal, relation: str) -> z3.BoolRef:
    enumerated, other = (x, y) if len(x.cases) > 1 else (y, x)
    if relation == "==" and len(enumerated.cases) > 1:
        finite_cases = ((v, c) for v, c in enumerated.cases if math.isfinite(v))
        return any_of(both(c, other.value == constant(v).value) for v, c in finite_cases)
    a, b = whole_of(x), whole_of(y)
    left, right = (x.value, y.value) if a is None or b is None else (a, b)
    match relation:
        case "==":
            return cast(z3.BoolRef, left == right)
        case "<":
            return cast(z3.BoolRef, left < right)
        case _:
            return cast(z3.BoolRef, left <= right)


def _infinite_comparison(x: ExtendedReal, y: ExtendedReal, relation: str, swapped: bool) -> z3.BoolRef:
    """Return `x relation y` (`y relation x` if swapped) where `x` is infinite."""
    up, down = positive_value(x), negative_value(x)
    y_up, y_down = both(y.infinite, positive_value(y)), both(y.infinite, negative_value(y))
    match relation:
        case "==":
            return either(both(up, y_up), both(down, y_down))
        case "<":
            return both(up, negation(y_up)) if swapped else both(down, negation(y_down))
        case _:
            return either(up, y_down) if swapped else either(down, y_up)


def positive_value(x: ExtendedReal) -> z3.BoolRef:
    """Return the condition that `x.value` is above 0."""
    return _compared_with_zero(x, ">")


def negative_value(x: ExtendedReal) -> z3.BoolRef:
    """Return the condition that `x.value` is below 0."""
    return _compared_with_zero(x, "<")


def _compared_with_zero(x: ExtendedReal, relation: str) -> z3.BoolRef:
    if x.cases:
        return any_of(c for v, c in x.cases if (v > 0 if relation == ">" else v < 0))
    zero = constant(0.0)
    decided = _decided_by_bounds(x, zero, "<") if relation == "<" else _decided_by_bounds(zero, x, "<")
    if decided is not None:
        return decided
    return cast(z3.BoolRef, x.value > 0 if relation == ">" else x.value < 0)


def equal(x: Scalar, y: Scalar) -> z3.BoolRef:
    """Return the equality of floats: NaN equals nothing."""
    if isinstance(x, ExtendedReal) and isinstance(y, ExtendedReal):
        return compared(x, y, "==")
    assert not isinstance(x, ExtendedReal)
    assert not isinstance(y, ExtendedReal)
    return choice(x, y, negation(y))


# --- choice --------------------------------------------------------------------------------------


def select(condition: z3.BoolRef, yes: Scalar, no: Scalar) -> Scalar:
    """Return `yes` where `condition`, else `no`."""
    if isinstance(yes, ExtendedReal):
        assert isinstance(no, ExtendedReal)
        return select_number(condition, yes, no)
    assert not isinstance(no, ExtendedReal)
    return choice(condition, yes, no)


def select_number(condition: z3.BoolRef, yes: ExtendedReal, no: ExtendedReal) -> ExtendedReal:
    """Return a number that is `yes` where the condition holds, else `no`."""
    if is_true(condition):
        return yes
    if is_false(condition):
        return no
    otherwise = negation(condition)
    if yes.cases and no.cases and len(yes.cases) + len(no.cases) <= MAX_CASES:
        rows = [
            *((v, both(condition, c)) for v, c in yes.cases),
            *((v, both(otherwise, c)) for v, c in no.cases),
        ]
        return by_cases(rows, loose_zero=yes.loose_zero or no.loose_zero)
    a, b = whole_of(yes), whole_of(no)
    nan, infinite = choice(condition, yes.nan, no.nan), choice(condition, yes.infinite, no.infinite)
    bounds = hull_of(yes, no)
    if a is not None and b is not None:
        whole = pick(condition, a, b)
        return ExtendedReal(z3.ToReal(whole), nan, infinite, bounds, whole, branches=(yes, no))
    value = pick(condition, yes.value, no.value)
    return ExtendedReal(value, nan, infinite, replace(bounds, whole=False), branches=(yes, no))


def select_first(conditions: Sequence[z3.BoolRef], values: Sequence[Scalar]) -> Scalar:
    """Return the value whose condition holds; the last value if none does, whatever its condition.

    At most one condition may hold.
    """
    *before, last = values
    numbers = [x for x in values if isinstance(x, ExtendedReal)]
    distinct = {(v, math.copysign(1.0, v)) for x in numbers for v, _ in x.cases}
    if len(numbers) == len(values) and all(x.cases for x in numbers) and len(distinct) <= MAX_CASES:
        others = conditions[: len(before)]
        chosen = [*others, negation(any_of(others))]
        rows = [(v, both(c, case)) for c, x in zip(chosen, numbers, strict=True) for v, case in x.cases]
        return by_cases(rows, loose_zero=any(x.loose_zero for x in numbers))
    if isinstance(last, ExtendedReal) and len(distinct) > MAX_CASES:
        last = replace(last, cases=())  # all together are too many, so none are merged on the way
    for condition, value in zip(reversed(conditions[: len(before)]), reversed(before), strict=True):
        last = select(condition, value, last)
    return last


# --- sums ----------------------------------------------------------------------------------------


def negated(x: ExtendedReal) -> ExtendedReal:
    """Return `-x`, exactly."""
    folded = fold(lambda v: -v, (x,))
    if folded is not None:
        return folded
    low, high = x.bounds.low, x.bounds.high
    bounds = NumberBounds(None if high is None else -high, None if low is None else -low, x.bounds.whole)
    if x.whole is not None:
        return ExtendedReal(z3.ToReal(-x.whole), x.nan, x.infinite, bounds, -x.whole)
    return ExtendedReal(-x.value, x.nan, x.infinite, bounds)


def added(x: ExtendedReal, y: ExtendedReal) -> ExtendedReal:
    """Return `x + y` over the reals."""
    folded = fold(lambda v, w: v + w, (x, y))
    if folded is not None:
        return folded
    if constant_of(y) == 0:
        return x
    if constant_of(x) == 0:
        return y
    bounds = _sum_bounds(x.bounds, y.bounds)
    nan, infinite = either(x.nan, y.nan), either(x.infinite, y.infinite)
    if not is_false(infinite):
        opposite = negation(equal_signs(x, y))
        nan = either(nan, all_of((x.infinite, y.infinite, opposite)))
    a, b = whole_of(x), whole_of(y)
    if a is not None and b is not None:
        whole = pick(x.infinite, a, pick(y.infinite, b, a + b))
        return ExtendedReal(z3.ToReal(whole), nan, infinite, bounds, whole)
    value = pick(x.infinite, x.value, pick(y.infinite, y.value, x.value + y.value))
    return ExtendedReal(value, nan, infinite, replace(bounds, whole=False))


def _sum_bounds(x: NumberBounds, y: NumberBounds) -> NumberBounds:
    low = None if x.low is None or y.low is None else x.low + y.low
    high = None if x.high is None or y.high is None else x.high + y.high
    return NumberBounds(low, high, x.whole and y.whole)


def equal_signs(x: ExtendedReal, y: ExtendedReal) -> z3.BoolRef:
    """Return the condition that two values other than 0 have the same sign."""
    return choice(positive_value(x), positive_value(y), negation(positive_value(y)))


def scaled(x: ExtendedReal, factor: Fraction) -> ExtendedReal:
    """Return `x` times a real that is not 0, over the reals."""
    ends = [None if end is None else end * factor for end in (x.bounds.low, x.bounds.high)]
    low, high = ends if factor > 0 else ends[::-1]
    unscaled = whole_of(x) if factor.denominator == 1 else None
    whole = None if unscaled is None else unscaled * integer(factor.numerator)
    bounds = NumberBounds(low, high, whole is not None)
    value = z3.ToReal(whole) if whole is not None else x.value * real(factor)
    return ExtendedReal(value, x.nan, x.infinite, bounds, whole)


# --- least and greatest --------------------------------------------------------------------------


def least(numbers: Sequence[ExtendedReal]) -> ExtendedReal:
    """Return the least number, the first among equals; NaN if any is NaN, or there is none."""
    return _best(numbers, lambda x, best: compared(x, best, "<"), lower=True)


def greatest(numbers: Sequence[ExtendedReal]) -> ExtendedReal:
    """Return the greatest number, the first among equals; NaN if any is NaN, or there is none."""
    return _best(numbers, lambda x, best: compared(best, x, "<"), lower=False)


def _best(
    numbers: Sequence[ExtendedReal], better: Callable[[ExtendedReal, ExtendedReal], z3.BoolRef], lower: bool
) -> ExtendedReal:
    if not numbers:
        return constant(math.nan)
    nan = any_of(x.nan for x in numbers)
    best = numbers[0]
    for x in numbers[1:]:
        bounds = _best_bounds(best, x, lower)
        best = select_number(better(x, best), x, best)
        if not best.cases:
            is_bounded = bounds.low is not None and bounds.high is not None
            best = replace(best, bounds=bounds, infinite=FALSE if is_bounded else best.infinite)
    if best.cases:
        return best if is_false(nan) else select_number(nan, constant(math.nan), best)
    return replace(best, nan=nan)


def _best_bounds(x: ExtendedReal, y: ExtendedReal, lower: bool) -> NumberBounds:
    """Return the bounds of the lesser (greater) of two, where neither is NaN."""
    whole = x.bounds.whole and y.bounds.whole
    lows = [b for b in (x.bounds.low, y.bounds.low) if b is not None]
    highs = [b for b in (x.bounds.high, y.bounds.high) if b is not None]
    if lower:
        return NumberBounds(min(lows) if len(lows) == 2 else None, min(highs, default=None), whole)
    return NumberBounds(max(lows, default=None), max(highs) if len(highs) == 2 else None, whole)
