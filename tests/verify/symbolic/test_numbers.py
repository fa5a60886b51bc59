"""Bounds of numbers that changed, through choices that share their branches."""

from __future__ import annotations

from fractions import Fraction

import z3

from colony.verify.symbolic.logic import FALSE
from colony.verify.symbolic.numbers import changed_bounds
from colony.verify.symbolic.system import ExtendedReal, NumberBounds


def number(name: str, low: int, high: int, *branches: ExtendedReal) -> ExtendedReal:
    bounds = NumberBounds(low=Fraction(low), high=Fraction(high))
    return ExtendedReal(z3.Real(name), FALSE, FALSE, bounds, branches=branches)


def test_branches_that_change_count() -> None:
    old, near, far = number("old", 0, 9), number("near", 1, 2), number("far", 5, 7)
    assert changed_bounds(old, old) is None
    assert changed_bounds(near, old) == near.bounds
    assert changed_bounds(number("a", 0, 9, old, near), old) == near.bounds
    either = number("b", 0, 9, number("c", 0, 9, old, far), old)
    assert changed_bounds(either, old) == far.bounds
    assert changed_bounds(number("d", 0, 8, either, near), old) == NumberBounds(
        low=Fraction(0), high=Fraction(8)
    )


def test_branches_that_are_shared_are_looked_at_once() -> None:
    old = number("old", 0, 9)
    x = number("a", 0, 9, old, number("b", 1, 2))
    for i in range(200):  # 2^200 ways down
        x = number(f"x{i}", 0, 9, x, x)
    assert changed_bounds(x, old) == x.bounds
