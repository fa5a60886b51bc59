"""Exact comparison of times with constants.

A time is nanoseconds / 1e9, rounded. As rounding is monotone, comparing a time with a constant is the same
as comparing its nanoseconds with a threshold, which a binary search finds.
"""

from __future__ import annotations

import math
from typing import cast

import z3

from colony.verify.symbolic.logic import TRUE, any_of, both, integer, negation
from colony.verify.symbolic.system import Number

_MAX_SECONDS = 1e12  # longer than any program waits, and far from overflow


def compared_time(x: Number, y: Number, relation: str) -> z3.BoolRef | None:
    """Return `x relation y` (`<`, `<=`, `==`) of a time and a constant in either order; None for others."""
    if x.nanoseconds is not None and _are_moderate_constants(y):
        time = x.nanoseconds
        return any_of(both(condition, _time_on_left(time, v, relation)) for v, condition in y.cases)
    if y.nanoseconds is not None and _are_moderate_constants(x):
        time = y.nanoseconds
        return any_of(both(condition, _time_on_right(time, v, relation)) for v, condition in x.cases)
    return None


def _are_moderate_constants(x: Number) -> bool:
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
