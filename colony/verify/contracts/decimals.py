"""Values as a person would write them in a `test`: short decimals in the declared unit."""

from __future__ import annotations

import math
from decimal import Decimal
from fractions import Fraction
from typing import NamedTuple

from colony.ir.program import Sensor
from colony.ir.types import Quantity, element_type
from colony.text.units import BASE_UNITS, parse_unit

_MAX_DIGITS = 17


class NumberText(NamedTuple):
    """A number as the language writes it: a sign, digits, and a unit if it has one."""

    digits: str
    unit: str | None
    negative: bool

    def __str__(self) -> str:
        """Return the number as the language writes it."""
        return f"{'-' if self.negative else ''}{self.digits}{f' {self.unit}' if self.unit else ''}"


def value_of(written: NumberText) -> float:
    """Return the number's value in base units: converted exactly and rounded once.

    Raises:
        OverflowError: it is too large for a float.
    """
    exact = Fraction(Decimal(written.digits)) * (parse_unit(written.unit).factor if written.unit else 1)
    value = float(exact)
    return -value if written.negative else value


def number_text(value: float, sensor: Sensor) -> NumberText | None:
    """Return the shortest number in the unit of `sensor`, else in base units, that is exactly `value`.

    None if there is no such number, e.g. for a value that is not finite.
    """
    if not math.isfinite(value):
        return None
    for unit in dict.fromkeys((sensor.unit or None, _base_unit(sensor))):
        for digits in range(1, _MAX_DIGITS + 1):
            candidate = _rounded(value, unit, digits)
            if candidate is not None and _has_value(candidate, value):
                return candidate
    return None


def _has_value(written: NumberText, value: float) -> bool:
    try:
        return value_of(written) == value
    except OverflowError:
        return False


def rounded(value: float, sensor: Sensor, digits: int) -> float:
    """Return `value`, in base units, rounded to a number of significant digits in the unit of `sensor`."""
    candidate = _rounded(value, sensor.unit or None, digits) if math.isfinite(value) else None
    try:
        return value if candidate is None else value_of(candidate)
    except OverflowError:
        return value


def _rounded(value: float, unit: str | None, digits: int) -> NumberText | None:
    factor = parse_unit(unit).factor if unit else Fraction(1)
    try:
        in_unit = float(Fraction(value) / factor)
    except OverflowError:
        return None
    return NumberText(plain(Decimal(f"{abs(in_unit):.{digits - 1}e}")), unit, math.copysign(1, in_unit) < 0)


def plain(number: Decimal) -> str:
    """Return the digits without an exponent where that is readable, and without needless zeros."""
    if number == 0:
        return "0"
    if -7 < number.adjusted() < 12:
        text = f"{number:f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    mantissa, _, exponent = f"{number.normalize():e}".partition("e")
    return f"{mantissa}e{int(exponent)}"


def _base_unit(sensor: Sensor) -> str | None:
    type_ = element_type(sensor.type)
    if not isinstance(type_, Quantity) or not any(type_.dimension):
        return None
    text = str(type_.dimension)
    return text if text in BASE_UNITS or "/" in text or "*" in text or "^" in text else None


def seconds(t_ns: int) -> NumberText:
    """Return a time in seconds, exactly."""
    return NumberText(plain(Decimal(t_ns) / 1_000_000_000), "s", False)
