"""Physical dimensions and the units of the language.

Internally, lengths are in millimeters, times in seconds and angles in degrees. The language has ten units, so
it does without a general units library, which would take a quarter of a second to import.
"""

from __future__ import annotations

import re
from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple


class Dimension(NamedTuple):
    """The exponents of length, time and angle; an angle counts as a dimension of its own."""

    length: int = 0
    time: int = 0
    angle: int = 0

    def times(self, other: Dimension) -> Dimension:
        """Return the dimension of a product."""
        return Dimension(self.length + other.length, self.time + other.time, self.angle + other.angle)

    def over(self, other: Dimension) -> Dimension:
        """Return the dimension of a quotient."""
        return Dimension(self.length - other.length, self.time - other.time, self.angle - other.angle)

    def power(self, exponent: int) -> Dimension:
        """Return the dimension of a power."""
        return Dimension(self.length * exponent, self.time * exponent, self.angle * exponent)

    def __str__(self) -> str:
        """Return the dimension in base units, such as `mm/s`, or `number` if it is dimensionless."""
        numerator = [_factor(n, e) for n, e in zip(_BASE, self, strict=True) if e > 0]
        denominator = [_factor(n, -e) for n, e in zip(_BASE, self, strict=True) if e < 0]
        if numerator:
            return "*".join(numerator) + "".join(f"/{d}" for d in denominator)
        if denominator:
            return "*".join(_factor(n, e) for n, e in zip(_BASE, self, strict=True) if e < 0)
        return "number"


def _factor(name: str, exponent: int) -> str:
    return name if exponent == 1 else f"{name}^{exponent}"


_BASE = ("mm", "s", "deg")
NUMBER = Dimension()
LENGTH = Dimension(length=1)
TIME = Dimension(time=1)
ANGLE = Dimension(angle=1)

_PI = Fraction("3.14159265358979323846264338327950288419716939937510582097494459")

BASE_UNITS: dict[str, tuple[Dimension, Fraction]] = {
    "mm": (LENGTH, Fraction(1)),
    "cm": (LENGTH, Fraction(10)),
    "m": (LENGTH, Fraction(1000)),
    "inch": (LENGTH, Fraction(254, 10)),
    "ft": (LENGTH, Fraction(3048, 10)),
    "ms": (TIME, Fraction(1, 1000)),
    "s": (TIME, Fraction(1)),
    "min": (TIME, Fraction(60)),
    "deg": (ANGLE, Fraction(1)),
    "rad": (ANGLE, 180 / _PI),
}


class Unit(NamedTuple):
    """A unit as written, its dimension, and its exact factor to the base unit (mm, s, deg)."""

    text: str
    dimension: Dimension
    factor: Fraction


class UnitError(ValueError):
    """The text is not a unit; the message names the invalid part."""


MAX_EXPONENT = 9

_PART = re.compile(r"([*/]?)([A-Za-z_][A-Za-z0-9_]*)(?:\^(-?[0-9]+))?")


@lru_cache(maxsize=1024)
def parse_unit(text: str) -> Unit:
    """Read `mm`, `m/s^2`, `s^-1`: products, quotients and whole powers of the base units.

    Raises:
        UnitError: a name is not in the table, or an exponent is beyond `MAX_EXPONENT`.
    """
    dimension, factor, position = NUMBER, Fraction(1), 0
    while position < len(text) or position == 0:
        part = _PART.match(text, position)
        if part is None or (position == 0) == bool(part[1]):
            raise UnitError(f"`{text}` is not a unit")
        operator, name, exponent_text = part.groups()
        if name not in BASE_UNITS:
            raise UnitError(f"`{name}` is not a unit")
        exponent = int(exponent_text[:4]) if exponent_text else 1
        if abs(exponent) > MAX_EXPONENT:
            raise UnitError(f"exponent {exponent_text} is beyond {MAX_EXPONENT}")
        exponent = -exponent if operator == "/" else exponent
        dimension_of_name, scale = BASE_UNITS[name]
        dimension = dimension.times(dimension_of_name.power(exponent))
        factor *= scale**exponent
        position = part.end()
    return Unit(text, dimension, factor)


def nanoseconds(seconds: float) -> int:
    """Return a finite time in seconds as whole nanoseconds, rounded once (half to even)."""
    return round(Fraction(seconds) * 1_000_000_000)
