"""The scalar functions of compiled programs, as the language defines them.

They raise on no float, so values computed from the placeholder of a missing sensor are harmless. All results
are exact to the bit, including the sign of zero. Each function uses only `math`, as the Python backend copies
the functions that a program uses into the generated program.
"""

from __future__ import annotations

from math import ceil, copysign, floor, inf, isfinite, nan, sqrt


def minimum(*values: float) -> float:
    """Return the least value, the first among equals; NaN if any is NaN."""
    least = values[0]
    for value in values:
        if value != value:
            return nan
        if value < least:
            least = value
    return least


def maximum(*values: float) -> float:
    """Return the greatest value, the first among equals; NaN if any is NaN."""
    greatest = values[0]
    for value in values:
        if value != value:
            return nan
        if value > greatest:
            greatest = value
    return greatest


def total(*values: float) -> float:
    """Return the sum from left to right, starting with the first value (`sum` compensates for rounding)."""
    result = values[0]
    for value in values[1:]:
        result = result + value
    return result


def count(*values: bool) -> float:
    """Return the number of true values."""
    return float(sum(values))


def index_of_min(*values: float) -> float:
    """Return the index of the least value, the first among equals; numbers beat NaN; 0 if all are NaN."""
    numbers = [value for value in values if value == value]
    return float(values.index(min(numbers))) if numbers else 0.0


def index_of_max(*values: float) -> float:
    """Return the index of the greatest value, the first among equals; numbers beat NaN; 0 if all are NaN."""
    numbers = [value for value in values if value == value]
    return float(values.index(max(numbers))) if numbers else 0.0


def divide(x: float, y: float) -> float:
    """Divide by IEEE 754: a division by zero gives an infinity, or NaN for 0 / 0 and NaN / 0."""
    if y:
        return x / y
    if x:
        return nan if x != x else copysign(inf, x) * copysign(1.0, y)
    return nan


def modulo(x: float, y: float) -> float:
    """Return the remainder with the sign of `y`, as Python's `%`; NaN for y = 0."""
    return x % y if y else nan


def square_root(x: float) -> float:
    """Return the square root: NaN for a negative number, -0.0 for -0.0."""
    return nan if x < 0.0 else sqrt(x)


def sign_of(x: float) -> float:
    """Return 1.0, -1.0, or 0.0 for either zero; NaN for NaN."""
    return 1.0 if x > 0.0 else -1.0 if x < 0.0 else 0.0 if x == x else nan


def round_down(x: float) -> float:
    """Return the greatest whole number not above `x`; a zero has the sign of `x`."""
    return copysign(float(floor(x)), x) if isfinite(x) else x


def round_up(x: float) -> float:
    """Return the least whole number not below `x`; a zero has the sign of `x`."""
    return copysign(float(ceil(x)), x) if isfinite(x) else x


def round_even(x: float) -> float:
    """Return the nearest whole number, halves to even; a zero has the sign of `x`."""
    return copysign(float(round(x)), x) if isfinite(x) else x


def pick_number(table: tuple[float, ...] | list[float], index: float) -> float:
    """Return the element at `index`, rounded (halves to even) modulo the size; NaN if it is not finite."""
    return table[round(index) % len(table)] if isfinite(index) else nan


def pick_bool(table: tuple[bool, ...] | list[bool], index: float) -> bool:
    """Return the element at `index`, rounded (halves to even) modulo the size; false if it is not finite."""
    return table[round(index) % len(table)] if isfinite(index) else False
