"""Arithmetic that rounds or needs new constants: sums, products, quotients, remainders, rounding to integers.

The result of a nonlinear operation is a free constant of the solver, of which only signs and bounds are
assumed. Such assumptions are satisfiable for all operands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from typing import cast

import z3

from colony.ir.angles import direction
from colony.ir.bearings import TURN, Bearings, lookup
from colony.ir.expression import Function
from colony.text.source import Span
from colony.verify.reference.expressions import divide, modulo, unary_function
from colony.verify.symbolic import bounding
from colony.verify.symbolic.builder import SystemBuilder
from colony.verify.symbolic.cases import ANY_ZERO, by_cases, constant, fold, whole_of
from colony.verify.symbolic.logic import (
    FALSE,
    TRUE,
    all_of,
    any_of,
    both,
    either,
    implied,
    is_false,
    negation,
    pick,
    real,
)
from colony.verify.symbolic.numbers import (
    added,
    compared,
    equal_signs,
    finite,
    greatest,
    is_exact_whole,
    least,
    negated,
    negative_value,
    positive_value,
    scaled,
    select_number,
    whole_number,
)
from colony.verify.symbolic.system import UNBOUNDED, ExtendedReal, Inexact, NumberBounds, Operation, Reason

MAX_ENUMERATED = 40
"""Maximum number of integers to enumerate by comparisons; beyond it the result is a constant of sort Int."""

ZERO = constant(0.0)


@dataclass(frozen=True, slots=True)
class Arithmetic:
    """The operations of the expression at `span`, which is cited as the reason where a result is inexact."""

    builder: SystemBuilder
    span: Span

    # --- sums ------------------------------------------------------------------------------------

    def add(self, x: ExtendedReal, y: ExtendedReal) -> ExtendedReal:
        """Return `x + y`."""
        result = added(x, y)
        if result.cases or result is x or result is y or is_exact_whole(result.bounds):
            return result
        may_overflow = not (_is_small(x) or _is_small(y))
        return self._mark_rounded(result, "a sum", (x.value, y.value), may_overflow, is_sum=True)

    def subtract(self, x: ExtendedReal, y: ExtendedReal) -> ExtendedReal:
        """Return `x - y`."""
        if x.cases and y.cases:
            folded = fold(lambda v, w: v - w, (x, y))
            if folded is not None:
                return folded
        return self.add(x, negated(y))

    def _mark_rounded(
        self,
        x: ExtendedReal,
        operation: str,
        floats: tuple[z3.ArithRef, ...] = (),
        may_overflow: bool = True,
        *,
        is_sum: bool = False,
    ) -> ExtendedReal:
        """Mark a number as rounded by the program; if `may_overflow`, possibly to infinity.

        `floats` and `is_sum` are those of the `InexactTerm`.
        """
        text = f"{operation}: reals in place of floats"
        return self._mark_inexact(x, Inexact.ROUNDING, text, may_overflow, floats, is_sum=is_sum)

    def _mark_abstracted(self, x: ExtendedReal, text: str, may_overflow: bool = False) -> ExtendedReal:
        return self._mark_inexact(x, Inexact.ABSTRACTED, text, may_overflow)

    def _mark_inexact(
        self,
        x: ExtendedReal,
        kind: Inexact,
        text: str,
        may_overflow: bool,
        floats: tuple[z3.ArithRef, ...] = (),
        *,
        is_sum: bool = False,
    ) -> ExtendedReal:
        as_float = replace(x, bounds=bounding.float_bounds(x.bounds))
        self.builder.mark_number_inexact(as_float, Reason(kind, self.span, text), floats, is_sum=is_sum)
        x = replace(x, bounds=bounding.rounded(x.bounds))
        if not may_overflow or bounding.never_overflows(x.bounds):
            return x
        overflows = self.builder.overflow(replace(x, nan=FALSE, infinite=FALSE), self.span)
        return replace(x, infinite=either(x.infinite, overflows))

    # --- products --------------------------------------------------------------------------------

    def multiply(self, x: ExtendedReal, y: ExtendedReal) -> ExtendedReal:
        """Return `x * y`."""
        folded = fold(lambda v, w: v * w, (x, y))
        if folded is not None:
            return folded
        enumerated, other = (x, y) if x.cases and (not y.cases or len(x.cases) <= len(y.cases)) else (y, x)
        if enumerated.cases:
            return self._per_case(enumerated, lambda v: self._multiply_by_constant(other, v))
        return self._product(x, y)

    def _per_case(
        self, enumerated: ExtendedReal, result_for: Callable[[float], ExtendedReal]
    ) -> ExtendedReal:
        *others, (last, _) = enumerated.cases
        result = result_for(last)
        for v, condition in reversed(others):
            result = select_number(condition, result_for(v), result)
        return result

    def _multiply_by_constant(self, x: ExtendedReal, factor: float) -> ExtendedReal:
        """Return `x` times a constant."""
        if math.isnan(factor):
            return constant(math.nan)
        if factor == 0:
            return select_number(finite(x), ANY_ZERO, constant(math.nan))
        if math.isinf(factor):
            sign = scaled(x, Fraction(1 if factor > 0 else -1))
            zero = both(negation(x.infinite), cast(z3.BoolRef, x.value == real(0)))
            return ExtendedReal(sign.value, either(x.nan, zero), not_nan(x), UNBOUNDED)
        if factor == 1:
            return x
        result = scaled(x, Fraction(factor))
        if factor == -1 or is_exact_whole(result.bounds):
            return result
        return self._mark_rounded(result, "a product", (x.value, -x.value), may_overflow=abs(factor) > 1)

    def _product(self, x: ExtendedReal, y: ExtendedReal) -> ExtendedReal:
        if x.value.get_id() > y.value.get_id():
            x, y = y, x
        nan = any_of((x.nan, y.nan, _infinite_times_zero(x, y), _infinite_times_zero(y, x)))
        infinite = either(x.infinite, y.infinite)
        bounds = bounding.product(x.bounds, y.bounds)
        if self.builder.precise:
            return self._mark_rounded(ExtendedReal(x.value * y.value, nan, infinite, bounds), "a product")
        term, is_new = self.builder.auxiliary(Operation.PRODUCT, (x, y), z3.RealSort())
        if is_new:
            self._assume(term, bounding.product_facts(term, x, y, bounds))
        text = "a product of two values that vary: only its sign and bounds are known"
        return self._mark_abstracted(ExtendedReal(term, nan, infinite, bounds), text, may_overflow=True)

    def _assume(self, term: z3.ArithRef, facts: Iterable[bounding.NonlinearFact]) -> None:
        for formula, only_over_reals in facts:
            self.builder.assume(term, formula, only_over_reals)

    # --- quotients -------------------------------------------------------------------------------

    def divide(self, x: ExtendedReal, y: ExtendedReal) -> ExtendedReal:
        """Return `x / y`."""
        folded = fold(divide, (x, y))
        if folded is not None:
            return folded
        if y.cases:
            return self._per_case(y, lambda v: self._divide_by_constant(x, v, y.loose_zero))
        return self._quotient(x, y)

    def _divide_by_constant(self, x: ExtendedReal, divisor: float, loose_zero: bool) -> ExtendedReal:
        """Return `x` divided by a constant; if `loose_zero`, a zero divisor may have either sign."""
        if math.isnan(divisor):
            return constant(math.nan)
        if divisor == 0 and loose_zero:
            return self._quotient(x, ANY_ZERO)
        if math.isinf(divisor):
            return select_number(finite(x), ANY_ZERO, constant(math.nan))
        if divisor == 0:
            sign = scaled(x, Fraction(int(math.copysign(1.0, divisor))))
            zero = both(negation(x.infinite), cast(z3.BoolRef, x.value == real(0)))
            return ExtendedReal(sign.value, either(x.nan, zero), negation(x.nan), UNBOUNDED)
        if divisor == 1:
            return x
        result = scaled(x, 1 / Fraction(divisor))
        return (
            result
            if divisor == -1
            else self._mark_rounded(result, "a quotient", (x.value, -x.value), may_overflow=abs(divisor) < 1)
        )

    def _quotient(self, x: ExtendedReal, y: ExtendedReal) -> ExtendedReal:
        by_zero = both(negation(y.infinite), compared(y, ZERO, "=="))
        zero_dividend = both(negation(x.infinite), compared(x, ZERO, "=="))
        nan = any_of((x.nan, y.nan, both(by_zero, zero_dividend), both(x.infinite, y.infinite)))
        infinite = either(by_zero, x.infinite)
        term, is_new = self.builder.auxiliary(Operation.QUOTIENT, (x, y), z3.RealSort())
        bounds = bounding.quotient(x.bounds, y.bounds)
        if is_new:
            precise = self.builder.precise
            self._assume(term, bounding.quotient_facts(term, x, y, by_zero, nan, bounds, precise))
        result = ExtendedReal(term, nan, infinite, bounds)
        if self.builder.precise and is_false(by_zero):
            return self._mark_rounded(result, "a quotient")
        return self._mark_abstracted(
            result,
            "a quotient of two values that vary: only its sign and bounds are known",
            may_overflow=True,
        )

    # --- remainders ------------------------------------------------------------------------------

    def modulo(self, x: ExtendedReal, y: ExtendedReal) -> ExtendedReal:
        """Return `mod(x, y)`."""
        folded = fold(modulo, (x, y))
        if folded is not None:
            return folded
        if y.cases:
            return self._per_case(y, lambda v: self._modulo_by_constant(x, v))
        term, is_new = self.builder.auxiliary(Operation.MODULO, (x, y), z3.RealSort())
        by_zero = both(negation(y.infinite), compared(y, ZERO, "=="))
        nan = any_of((x.nan, y.nan, x.infinite, by_zero))
        # mod(x, inf) is x, or inf where the signs differ
        opposite_signs = both(cast(z3.BoolRef, x.value != real(0)), negation(equal_signs(x, y)))
        infinite = both(y.infinite, opposite_signs)
        if is_new:
            self._assume(term, bounding.modulo_facts(term, x, y, nan))
        bounds = bounding.modulo(y.bounds)
        return self._mark_abstracted(
            ExtendedReal(term, nan, infinite, bounds), "`mod` by a value that varies"
        )

    def _modulo_by_constant(self, x: ExtendedReal, divisor: float) -> ExtendedReal:
        if math.isnan(divisor) or divisor == 0:
            return constant(math.nan)
        nan = either(x.nan, x.infinite)
        if math.isinf(divisor):
            opposite_sign = negative_value(x) if divisor > 0 else positive_value(x)
            by_infinity = select_number(opposite_sign, constant(divisor), replace(x, infinite=FALSE))
            return _or_nan(nan, by_infinity)
        exact = Fraction(divisor)
        finite_x = replace(x, nan=FALSE, infinite=FALSE, cases=())
        multiple = self.floor_of(scaled(finite_x, 1 / exact))
        remainder = added(finite_x, scaled_without_cases(negated(multiple), exact))
        ends = (min(exact, Fraction(0)), max(exact, Fraction(0)))
        high = ends[1] - 1 if x.bounds.whole and exact.denominator == 1 and exact > 0 else ends[1]
        bounds = NumberBounds(ends[0], high, x.bounds.whole and exact.denominator == 1)
        if remainder.cases:
            return _or_nan(nan, remainder)
        result = replace(remainder, nan=nan, bounds=bounds)
        same_side = x.bounds.low is not None and x.bounds.low >= 0 and divisor > 0
        return (
            result
            if same_side or is_exact_whole(bounds)
            else self._mark_rounded(result, "`mod`", (x.value,), may_overflow=False)
        )

    def angle_difference(self, a: ExtendedReal, b: ExtendedReal) -> ExtendedReal:
        """Return the angle from `b` to `a` in degrees: above -180, up to 180."""
        turned = self.modulo(self.subtract(a, b), constant(360.0))
        if turned.cases:
            folded = fold(lambda d: d - 360.0 if d > 180.0 else d, (turned,))
            assert folded is not None
            return folded
        wrapped = self.add(turned, constant(-360.0))
        result = select_number(compared(constant(180.0), turned, "<"), wrapped, turned)
        return replace(result, bounds=NumberBounds(Fraction(-180), Fraction(180), result.bounds.whole))

    # --- whole numbers ---------------------------------------------------------------------------

    def floor(self, x: ExtendedReal) -> ExtendedReal:
        """Return the greatest whole number that is not above `x`."""
        return self._whole(x, Function.FLOOR, self.floor_of)

    def ceil(self, x: ExtendedReal) -> ExtendedReal:
        """Return the least whole number that is not below `x`."""
        return self._whole(x, Function.CEIL, lambda v: negated(self.floor_of(negated(v))))

    def round(self, x: ExtendedReal) -> ExtendedReal:
        """Return the nearest whole number, halves to even."""
        return self._whole(x, Function.ROUND, self.round_of)

    def _whole(
        self, x: ExtendedReal, function: Function, round_finite: Callable[[ExtendedReal], ExtendedReal]
    ) -> ExtendedReal:
        """Return a number rounded to an integer; NaN and infinities are unchanged."""
        folded = fold(lambda v: unary_function(function, v), (x,))
        if folded is not None:
            return folded
        if x.bounds.whole:
            return x
        rounded = round_finite(replace(x, nan=FALSE, infinite=FALSE))
        if is_false(x.infinite):
            return _or_nan(x.nan, rounded)
        value = pick(x.infinite, x.value, rounded.value)
        return ExtendedReal(value, x.nan, x.infinite, replace(rounded.bounds, whole=False))

    def floor_of(self, x: ExtendedReal) -> ExtendedReal:
        """Return the floor of a finite number; few possible values are enumerated, which solves faster."""
        if x.bounds.whole:
            return x
        low, high = bounding.floor_bounds(x.bounds)
        if low is not None and high is not None and _are_enumerable(low, high):
            return self._steps(low, high, lambda n: cast(z3.BoolRef, x.value >= integer_value(n)))
        term, is_new = self.builder.auxiliary(Operation.FLOOR, (x,), z3.IntSort())
        if is_new:
            self.builder.define(term, cast(z3.BoolRef, z3.ToReal(term) <= x.value))
            self.builder.define(term, cast(z3.BoolRef, x.value < z3.ToReal(term) + 1))
        return whole_number(term, _whole_bounds(low, high))

    def round_of(self, x: ExtendedReal) -> ExtendedReal:
        """Return the nearest whole number to a finite one, halves to even."""
        if x.bounds.whole:
            return x
        low, high = bounding.round_bounds(x.bounds)
        if low is not None and high is not None and _are_enumerable(low, high):
            return self._steps(low, high, lambda n: _reaches(x.value, n))
        term, is_new = self.builder.auxiliary(Operation.ROUND, (x,), z3.IntSort())
        if is_new:
            half, rounded = real(Fraction(1, 2)), z3.ToReal(term)
            even = cast(z3.BoolRef, term % 2 == 0)
            self.builder.define(term, cast(z3.BoolRef, rounded - half <= x.value))
            self.builder.define(term, cast(z3.BoolRef, x.value <= rounded + half))
            tie = either(
                cast(z3.BoolRef, x.value == rounded - half), cast(z3.BoolRef, x.value == rounded + half)
            )
            self.builder.define(term, implied(tie, even))
        return whole_number(term, _whole_bounds(low, high))

    def _steps(self, low: int, high: int, reaches: Callable[[int], z3.BoolRef]) -> ExtendedReal:
        """Return the greatest n in low .. high that `reaches` admits, by cases."""
        steps = [reaches(n) for n in range(low + 1, high + 1)]
        cases = []
        for i in range(high - low + 1):
            below_next = negation(steps[i]) if i < len(steps) else None
            reached = steps[i - 1] if i > 0 else None
            cases.append((float(low + i), all_of(c for c in (below_next, reached) if c is not None)))
        return by_cases(cases, loose_zero=True)

    # --- functions of one number -----------------------------------------------------------------

    def absolute(self, x: ExtendedReal) -> ExtendedReal:
        """Return `abs(x)`, exactly."""
        folded = fold(abs, (x,))
        if folded is not None:
            return folded
        result = select_number(negative_value(x), negated(x), x)
        low, high = x.bounds.low, x.bounds.high
        top = None if low is None or high is None else max(abs(low), abs(high))
        bottom = max(low or Fraction(0), -(high if high is not None else Fraction(0)), Fraction(0))
        return replace(result, bounds=NumberBounds(bottom, top, x.bounds.whole))

    def sign(self, x: ExtendedReal) -> ExtendedReal:
        """Return -1, 0 or 1; NaN for NaN."""
        folded = fold(lambda v: unary_function(Function.SIGN, v), (x,))
        if folded is not None:
            return folded
        is_number = negation(x.nan)
        up, down = both(is_number, positive_value(x)), both(is_number, negative_value(x))
        zero = all_of((is_number, negation(up), negation(down)))
        return by_cases(((math.nan, x.nan), (1.0, up), (-1.0, down), (0.0, zero)))

    def square_root(self, x: ExtendedReal) -> ExtendedReal:
        """Return `sqrt(x)`; NaN below 0."""
        folded = fold(lambda v: unary_function(Function.SQRT, v), (x,))
        if folded is not None:
            return folded
        nan = either(x.nan, negative_value(x))
        term, is_new = self.builder.auxiliary(Operation.SQRT, (x,), z3.RealSort())
        if is_new:
            self._assume(term, bounding.square_root_facts(term, x, nan))
        bounds = bounding.square_root(x.bounds)
        return self._mark_abstracted(
            ExtendedReal(term, nan, x.infinite, bounds), "`sqrt`: only bounds are known"
        )

    def sine(self, x: ExtendedReal, function: Function) -> ExtendedReal:
        """Return `sin(x)` or `cos(x)`; NaN for an infinity."""
        folded = fold(lambda v: unary_function(function, v), (x,))
        if folded is not None:
            return folded
        operation = Operation.SIN if function is Function.SIN else Operation.COS
        term, is_new = self.builder.auxiliary(operation, (x,), z3.RealSort())
        if is_new:
            self.builder.assume(term, all_of((cast(z3.BoolRef, term >= -1), cast(z3.BoolRef, term <= 1))))
        bounds = NumberBounds(Fraction(-1), Fraction(1))
        text = f"`{function.value}`: only bounds are known"
        return self._mark_abstracted(ExtendedReal(term, either(x.nan, x.infinite), FALSE, bounds), text)

    def tangent(self, x: ExtendedReal) -> ExtendedReal:
        """Return `tan(x)`; NaN of an infinity."""
        known = fold(lambda v: unary_function(Function.TAN, v), (x,))
        if known is not None:
            return known
        term, _ = self.builder.auxiliary(Operation.TAN, (x,), z3.RealSort())
        pole, is_new = self.builder.auxiliary(Operation.POLE, (x,), z3.BoolSort())
        nan = either(x.nan, x.infinite)
        infinite = both(negation(nan), cast(z3.BoolRef, pole))
        if is_new:
            one = cast(z3.BoolRef, z3.Or(term == 1, term == -1))
            self.builder.assume(cast(z3.BoolRef, pole), implied(cast(z3.BoolRef, pole), one))
        result = ExtendedReal(term, nan, infinite, UNBOUNDED)
        return self._mark_abstracted(result, "`tan`: nothing is known")

    def arc_sine(self, x: ExtendedReal, function: Function) -> ExtendedReal:
        """Return `asin(x)` or `acos(x)` in degrees; NaN outside -1 .. 1."""
        known = fold(lambda v: unary_function(function, v), (x,))
        if known is not None:
            return known
        is_sine = function is Function.ASIN
        operation, low, high = (Operation.ASIN, -90, 90) if is_sine else (Operation.ACOS, 0, 180)
        term, is_new = self.builder.auxiliary(operation, (x,), z3.RealSort())
        if is_new:
            self.builder.assume(term, all_of((cast(z3.BoolRef, term >= low), cast(z3.BoolRef, term <= high))))
        outside = either(x.infinite, cast(z3.BoolRef, z3.Or(x.value > 1, x.value < -1)))
        text = f"`{function.value}`: only bounds are known"
        bounds = NumberBounds(Fraction(low), Fraction(high))
        return self._mark_abstracted(ExtendedReal(term, either(x.nan, outside), FALSE, bounds), text)

    def arc_tangent(self, y: ExtendedReal, x: ExtendedReal) -> ExtendedReal:
        """Return `atan2(y, x)` in degrees."""
        known = fold(direction, (y, x))
        if known is not None:
            return known
        term, is_new = self.builder.auxiliary(Operation.ATAN2, (y, x), z3.RealSort())
        nan = either(y.nan, x.nan)
        if is_new:
            for formula in bounding.arc_tangent_facts(term, y, x):
                self.builder.assume(term, implied(negation(nan), formula))
        bounds = bounding.arc_tangent(y, x)
        text = "`atan2`: only bounds are known"
        return self._mark_abstracted(ExtendedReal(term, nan, FALSE, bounds), text)

    def clamp(self, x: ExtendedReal, low: ExtendedReal, high: ExtendedReal) -> ExtendedReal:
        """Return `min(max(x, low), high)`."""
        return least((greatest((x, low)), high))


# --- helpers -------------------------------------------------------------------------------------


def _is_small(x: ExtendedReal) -> bool:
    """Return True if the sum of `x` and a finite float never overflows."""
    low, high = x.bounds.low, x.bounds.high
    return low is not None and high is not None and max(-low, high) < _SMALL_MAGNITUDE


_SMALL_MAGNITUDE = 2**960


def _infinite_times_zero(x: ExtendedReal, y: ExtendedReal) -> z3.BoolRef:
    if is_false(x.infinite):
        return FALSE
    return all_of((x.infinite, negation(y.infinite), cast(z3.BoolRef, y.value == real(0))))


def not_nan(x: ExtendedReal) -> z3.BoolRef:
    """Return the condition that `x` is not NaN."""
    return negation(x.nan)


def _or_nan(nan: z3.BoolRef, x: ExtendedReal) -> ExtendedReal:
    """Return `x`, or NaN where `nan` holds."""
    if is_false(nan):
        return x
    return select_number(nan, constant(math.nan), x) if x.cases else replace(x, nan=either(nan, x.nan))


def scaled_without_cases(x: ExtendedReal, factor: Fraction) -> ExtendedReal:
    """Return `x` times a real, without cases, as products of cases need not be floats."""
    whole = whole_of(x)
    if whole is None:
        return scaled(x, factor)
    return scaled(replace(x, whole=whole if factor.denominator == 1 else None, cases=()), factor)


def integer_value(n: int) -> z3.ArithRef:
    """Return the term of an integer."""
    return real(n)


def _are_enumerable(low: int, high: int) -> bool:
    """Return True if low .. high are a few whole numbers, and each of them is a float."""
    return high - low < MAX_ENUMERATED and max(-low, high) <= 2**53


def _reaches(x: z3.ArithRef, n: int) -> z3.BoolRef:
    """Return the condition that a real rounds to `n` or more, halves to even."""
    half = real(Fraction(2 * n - 1, 2))
    return cast(z3.BoolRef, x >= half if n % 2 == 0 else x > half)


def _whole_bounds(low: int | None, high: int | None) -> NumberBounds:
    return NumberBounds(
        None if low is None else Fraction(low), None if high is None else Fraction(high), True
    )


# --- bearings -----------------------------------------------------------------------------------------
#
# The element nearest to an angle as a term.
#
# The interpreter takes an angle to [0, 360) with a modulo that rounds. Rounding is monotonic: where the angle
# is bounded by a turn, comparisons of the result with constants are comparisons of the angle, and exact.

_ZERO = constant(0.0)


def nearest(angle: ExtendedReal, bearings: Bearings, arithmetic: Arithmetic) -> ExtendedReal:
    """Return the index of the element whose bearing is nearest to an angle, NaN where there is none."""
    table, is_finite = lookup(bearings), finite(angle)
    above = _conditions_above(angle, table.breaks, arithmetic)
    cases = [(math.nan, negation(is_finite))]
    for n, index in enumerate(table.indices):
        after = TRUE if n == 0 else above[n - 1]
        upto = TRUE if n == len(above) else negation(above[n])
        cases.append((math.nan if index is None else float(index), all_of((is_finite, after, upto))))
    return by_cases(cases)


def _conditions_above(
    angle: ExtendedReal, breaks: tuple[float, ...], arithmetic: Arithmetic
) -> list[z3.BoolRef]:
    """Return the conditions that an angle, taken to [0, 360), is above each of some floats."""
    low, high = angle.bounds.low, angle.bounds.high
    if low is None or high is None or low < -TURN or high >= TURN:
        turned = arithmetic.modulo(angle, constant(float(TURN)))
        return [compared(constant(b), turned, "<") for b in breaks]
    is_negative = FALSE if low >= 0 else compared(angle, _ZERO, "<")
    return [
        either(
            both(negation(is_negative), compared(constant(b), angle, "<")),
            both(is_negative, compared(constant(_greatest_not_above(b)), angle, "<")),
        )
        for b in breaks
    ]


@cache
def _greatest_not_above(limit: float) -> float:
    """Return the greatest float below 0 that, taken to [0, 360), is at most `limit`, itself below 360."""
    # `low % 360` is 0.0 and `high % 360` rounds to 360.0, so that they bracket every limit in [0, 360).
    low, high = -float(TURN), -1e-20
    while math.nextafter(low, high) < high:
        middle = low + (high - low) / 2
        if middle % TURN <= limit:
            low = middle
        else:
            high = middle
    return low
