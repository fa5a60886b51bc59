"""The element nearest to an angle as a term.

The interpreter takes an angle to [0, 360) with a modulo that rounds. Rounding is monotonic: where the angle
is bounded by a turn, comparisons of the result with constants are comparisons of the angle, and exact.
"""

from __future__ import annotations

import math
from functools import cache

import z3

from colony.ir.bearings import TURN, Bearings, lookup
from colony.verify.symbolic.arithmetic import Arithmetic
from colony.verify.symbolic.cases import by_cases, constant
from colony.verify.symbolic.logic import FALSE, TRUE, all_of, both, either, negation
from colony.verify.symbolic.numbers import compared, finite
from colony.verify.symbolic.system import Number

_ZERO = constant(0.0)


def nearest(angle: Number, bearings: Bearings, arithmetic: Arithmetic) -> Number:
    """Return the index of the element whose bearing is nearest to an angle, NaN where there is none."""
    table, is_finite = lookup(bearings), finite(angle)
    above = _conditions_above(angle, table.breaks, arithmetic)
    cases = [(math.nan, negation(is_finite))]
    for n, index in enumerate(table.indices):
        after = TRUE if n == 0 else above[n - 1]
        upto = TRUE if n == len(above) else negation(above[n])
        cases.append((math.nan if index is None else float(index), all_of((is_finite, after, upto))))
    return by_cases(cases)


def _conditions_above(angle: Number, breaks: tuple[float, ...], arithmetic: Arithmetic) -> list[z3.BoolRef]:
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
