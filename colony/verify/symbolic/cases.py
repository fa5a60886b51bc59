"""Numbers that have only a few possible floats as values, and constant folding over these cases.

Constants are such numbers, as are enumerators, integers, and choices among constants. Folding applies the
interpreter's own functions, so its results are exact bit for bit.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache, reduce
from itertools import product
from typing import TypeVar

import z3

from colony.verify.symbolic.logic import FALSE, TRUE, all_of, any_of, integer, is_false, pick, real
from colony.verify.symbolic.system import UNBOUNDED, Case, ExtendedReal, NumberBounds

Result = TypeVar("Result", float, bool)

MAX_CASES = 64
"""Maximum number of cases of a number."""

MAX_FLOAT = Fraction(sys.float_info.max)


def constant(x: float) -> ExtendedReal:
    """Return the float `x`."""
    return _constant(x, math.copysign(1.0, x))


@lru_cache(maxsize=4096)
def _constant(x: float, sign: float) -> ExtendedReal:
    """Return the float `x` of this sign; the sign distinguishes the two zeros."""
    cases = ((x, TRUE),)
    if math.isnan(x):
        return ExtendedReal(real(0), TRUE, FALSE, cases=cases)
    if math.isinf(x):
        bounds = NumberBounds(MAX_FLOAT, None) if x > 0 else NumberBounds(None, -MAX_FLOAT)
        return ExtendedReal(real(1 if x > 0 else -1), FALSE, TRUE, bounds, cases=cases)
    exact = Fraction(x)
    whole = integer(exact.numerator) if exact.denominator == 1 else None
    return ExtendedReal(
        real(exact), FALSE, FALSE, NumberBounds(exact, exact, whole is not None), whole, cases
    )


def constant_of(x: ExtendedReal) -> float | None:
    """Return the value of `x` if it is a constant, else None."""
    return x.cases[0][0] if len(x.cases) == 1 else None


ANY_ZERO = ExtendedReal(real(0), FALSE, FALSE, NumberBounds(Fraction(0), Fraction(0), True), integer(0))
"""0.0 or -0.0."""


def by_cases(cases: Iterable[Case], loose_zero: bool = False) -> ExtendedReal:
    """Return a number from its cases, exactly one of which applies.

    With `loose_zero`, the case 0 may be -0.0 as well.
    """
    merged: dict[tuple[float, float] | None, list[z3.BoolRef]] = {}
    for x, condition in cases:
        if not is_false(condition):
            x = 0.0 if loose_zero and x == 0 else x
            key = None if math.isnan(x) else (x, math.copysign(1.0, x))
            merged.setdefault(key, []).append(condition)
    if len(merged) == 1:
        x = _float_of(next(iter(merged)))
        return ANY_ZERO if loose_zero and x == 0 else constant(x)
    kept = tuple((_float_of(key), any_of(conditions)) for key, conditions in merged.items())
    finite = [(x, condition) for x, condition in kept if not math.isnan(x)]
    value: z3.ArithRef = constant(finite[-1][0]).value if finite else real(0)
    for x, condition in reversed(finite[:-1]):
        value = pick(condition, constant(x).value, value)
    return replace(with_cases(value, kept), loose_zero=loose_zero)


def with_cases(value: z3.ArithRef, cases: tuple[Case, ...]) -> ExtendedReal:
    """Return a number with this term as its value and these cases."""
    nan = any_of(c for x, c in cases if math.isnan(x))
    infinite = any_of(c for x, c in cases if math.isinf(x))
    case_bounds = [constant(x).bounds for x, _ in cases if not math.isnan(x)]
    if not case_bounds:
        return ExtendedReal(value, nan, infinite, UNBOUNDED, None, cases)
    whole = all(x.is_integer() for x, _ in cases if math.isfinite(x))
    bounds = replace(reduce(hull, case_bounds), whole=whole)
    return ExtendedReal(value, nan, infinite, bounds, None, cases)


def _float_of(key: tuple[float, float] | None) -> float:
    return math.nan if key is None else key[0]


def whole_of(x: ExtendedReal) -> z3.ArithRef | None:
    """Return `x` as a term of sort Int if it is whole, else None; an infinity gives its sign."""
    if x.whole is not None or not x.cases:
        return x.whole
    values = [(v if math.isfinite(v) else math.copysign(1.0, v), c) for v, c in x.cases if not math.isnan(v)]
    if not all(v.is_integer() for v, _ in values):
        return None
    term: z3.ArithRef = integer(int(values[-1][0]) if values else 0)
    for v, condition in reversed(values[:-1]):
        term = pick(condition, integer(int(v)), term)
    return term


# --- functions of floats -------------------------------------------------------------------------


def case_results(
    apply: Callable[..., Result], operands: Sequence[ExtendedReal]
) -> list[tuple[Result, z3.BoolRef]]:
    """Return a function's result for each combination of cases; empty if there are too many.

    The function must not distinguish the two zeros.
    """
    return [(apply(*values), condition) for values, condition in _combinations(operands)]


def fold(apply: Callable[..., float], operands: Sequence[ExtendedReal]) -> ExtendedReal | None:
    """Apply a function to each combination of cases, bit for bit.

    None if there are too many combinations, or if the sign of a loose zero matters.
    """
    cases: list[Case] = []
    are_zeros_loose = [x.loose_zero for x in operands]
    loose_zero = False
    for values, condition in _combinations(operands):
        choices = [
            (v, -v) if v == 0 and is_loose else (v,)
            for v, is_loose in zip(values, are_zeros_loose, strict=True)
        ]
        results = [apply(*row) for row in product(*choices)]
        result = results[0]
        if not all(x == result or (math.isnan(x) and math.isnan(result)) for x in results):
            return None
        loose_zero |= result == 0 and len({math.copysign(1.0, x) for x in results}) > 1
        cases.append((result, condition))
    return by_cases(cases, loose_zero) if cases else None


def _combinations(operands: Sequence[ExtendedReal]) -> list[tuple[tuple[float, ...], z3.BoolRef]]:
    """Return all combinations of cases with their conditions; empty if there are too many."""
    if not 0 < math.prod(len(x.cases) for x in operands) <= MAX_CASES:
        return []
    rows = product(*(x.cases for x in operands))
    return [(tuple(v for v, _ in row), all_of(condition for _, condition in row)) for row in rows]


def hull(x: NumberBounds, y: NumberBounds) -> NumberBounds:
    """Return the tightest bounds that contain `x` and `y`."""
    low = None if x.low is None or y.low is None else min(x.low, y.low)
    high = None if x.high is None or y.high is None else max(x.high, y.high)
    return NumberBounds(low, high, x.whole and y.whole)
