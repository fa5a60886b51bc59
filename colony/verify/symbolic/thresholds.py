"""Exact comparison of times with constants.

A time is nanoseconds / 1e9, rounded. As rounding is monotone, comparing it with a constant is comparing the
nanoseconds with a threshold, which a binary search finds.
"""

from __future__ import annotations

import math
from typing import cast

import z3

from colony.verify.symbolic.logic import TRUE, any_of, both, integer, negation
from colony.verify.symbolic.system import Number

_MAX_SECONDS = 1e12  # longer than any program waits, and far from overflow


def against_constants(x: Number, y: Number, relation: str) -> z3.BoolRef | None:
    """Return `x relation y` (`<`, `<=`, `==`) of a time and a constant in either order; None for others."""
    if x.nanoseconds is not None and _are_usual(y):
        time = x.nanoseconds
        return any_of(both(condition, _before(time, v, relation)) for v, condition in y.cases)
    if y.nanoseconds is not None and _are_usual(x):
        time = y.nanoseconds
        return any_of(both(condition, _after(time, v, relation)) for v, condition in x.cases)
    return None


def _are_usual(x: Number) -> bool:
    return bool(x.cases) and all(abs(v) <= _MAX_SECONDS for v, _ in x.cases)


def _before(time: z3.ArithRef, constant: float, relation: str) -> z3.BoolRef:
    """Return `time relation constant`."""
    match relation:
        case "<":
            return negation(_reaches(time, constant))
        case "<=":
            return negation(_exceeds(time, constant))
        case _:
            return both(_reaches(time, constant), negation(_exceeds(time, constant)))


def _after(time: z3.ArithRef, constant: float, relation: str) -> z3.BoolRef:
    """Return `constant relation time`."""
    match relation:
        case "<":
            return _exceeds(time, constant)
        case "<=":
            return _reaches(time, constant)
        case _:
            return _before(time, constant, relation)


def _reaches(time: z3.ArithRef, constant: float) -> z3.BoolRef:
    """Return the condition that a time is `constant` or more."""
    return _from(time, first_ns_reaching(constant))


def _exceeds(time: z3.ArithRef, constant: float) -> z3.BoolRef:
    """Return the condition that a time is more than `constant`."""
    return _from(time, first_ns_reaching(math.nextafter(constant, math.inf)))


def _from(time: z3.ArithRef, nanoseconds: int) -> z3.BoolRef:
    return TRUE if nanoseconds <= 0 else cast(z3.BoolRef, time >= integer(nanoseconds))


def first_ns_reaching(constant: float) -> int:
    """Return the least number of nanoseconds, at least 0, that is `constant` seconds or more as a float."""
    below, there = -1, 1
    while there / 1e9 < constant:
        there *= 2
    while there - below > 1:
        middle = (below + there) // 2
        below, there = (below, middle) if middle / 1e9 >= constant else (middle, there)
    return there
