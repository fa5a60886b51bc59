"""The scalar functions of compiled programs, as the language defines them.

They raise on no float, so values computed from the placeholder of a missing sensor are harmless. All results
are exact to the bit, including the sign of zero. Each function uses only `math`, as the Python backend copies
the functions that a program uses into the generated program.
"""

from __future__ import annotations

from math import (
    atan2,
    ceil,
    copysign,
    cos,
    degrees,
    floor,
    inf,
    isfinite,
    isinf,
    nan,
    radians,
    sin,
    sqrt,
)


def minimum(*values: float) -> float:
    """The least, the first of equals; NaN if any is NaN."""
    least = values[0]
    for value in values:
        if value != value:
            return nan
        if value < least:
            least = value
    return least


def maximum(*values: float) -> float:
    """The greatest, the first of equals; NaN if any is NaN."""
    greatest = values[0]
    for value in values:
        if value != value:
            return nan
        if value > greatest:
            greatest = value
    return greatest


def total(*values: float) -> float:
    """The sum from the left, begun with the first (the built-in one compensates for rounding)."""
    result = values[0]
    for value in values[1:]:
        result = result + value
    return result


def count(*values: bool) -> float:
    """How many are true."""
    return float(sum(values))


def index_of_min(*values: float) -> float:
    """Where the least stands, the first of equals; NaN loses, and 0 where all are NaN."""
    numbers = [value for value in values if value == value]
    return float(values.index(min(numbers))) if numbers else 0.0


def index_of_max(*values: float) -> float:
    """Where the greatest stands, the first of equals; NaN loses, and 0 where all are NaN."""
    numbers = [value for value in values if value == value]
    return float(values.index(max(numbers))) if numbers else 0.0


def divide(x: float, y: float) -> float:
    """IEEE 754 division: by a zero it gives an infinity, or NaN for 0 / 0 and NaN / 0."""
    if y:
        return x / y
    if x:
        return nan if x != x else copysign(inf, x) * copysign(1.0, y)
    return nan


def modulo(x: float, y: float) -> float:
    """The remainder with the sign of `y`, as Python's `%`; NaN for y = 0."""
    return x % y if y else nan


def square_root(x: float) -> float:
    """NaN of a negative number; -0.0 of -0.0."""
    return nan if x < 0.0 else sqrt(x)


def sign_of(x: float) -> float:
    """1.0, -1.0, or 0.0 for either zero; NaN for NaN."""
    return 1.0 if x > 0.0 else -1.0 if x < 0.0 else 0.0 if x == x else nan


def round_down(x: float) -> float:
    """The greatest whole number that is not above; zeros keep the sign of `x`."""
    return copysign(float(floor(x)), x) if isfinite(x) else x


def round_up(x: float) -> float:
    """The least whole number that is not below; zeros keep the sign of `x`."""
    return copysign(float(ceil(x)), x) if isfinite(x) else x


def round_even(x: float) -> float:
    """The nearest whole number, the even one of two; zeros keep the sign of `x`."""
    return copysign(float(round(x)), x) if isfinite(x) else x


def sine(x: float) -> float:
    """Of degrees; NaN of an infinite angle."""
    return nan if isinf(x) else sin(radians(x))


def cosine(x: float) -> float:
    """Of degrees; NaN of an infinite angle."""
    return nan if isinf(x) else cos(radians(x))


def direction(y: float, x: float) -> float:
    """`atan2` in degrees."""
    return degrees(atan2(y, x))


def pick_number(table: tuple[float, ...] | list[float], index: float) -> float:
    """The element at `index`, rounded (halves to even) and modulo the size; NaN if it is not finite."""
    return table[round(index) % len(table)] if isfinite(index) else nan


def pick_bool(table: tuple[bool, ...] | list[bool], index: float) -> bool:
    """The element at `index`, rounded (halves to even) and modulo the size; false if it is not finite."""
    return table[round(index) % len(table)] if isfinite(index) else False
