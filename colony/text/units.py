"""Physical dimensions and the units of the language.

Internally, lengths are in millimeters, times in seconds, angles in degrees, currents in ampere, voltages in
volt and temperatures in degrees Celsius; other quantities follow (a watt is 1 A*V, a newton 1 W*s/m). A table
does: a general units library would take a quarter of a second to import.
"""

from __future__ import annotations

import re
from fractions import Fraction
from functools import lru_cache
from operator import add, sub
from typing import NamedTuple


class Dimension(NamedTuple):
    """The exponents of the base dimensions.

    An angle counts as a dimension of its own. A temperature is one of Celsius's scale: it has no offset.
    """

    length: int = 0
    time: int = 0
    angle: int = 0
    current: int = 0
    voltage: int = 0
    temperature: int = 0

    def times(self, other: Dimension) -> Dimension:
        """Return the dimension of a product."""
        return Dimension(*map(add, self, other))

    def over(self, other: Dimension) -> Dimension:
        """Return the dimension of a quotient."""
        return Dimension(*map(sub, self, other))

    def power(self, exponent: int) -> Dimension:
        """Return the dimension of a power."""
        return Dimension(*[e * exponent for e in self])

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


_BASE = ("mm", "s", "deg", "A", "V", "degC")
NUMBER = Dimension()
LENGTH = Dimension(length=1)
TIME = Dimension(time=1)
ANGLE = Dimension(angle=1)
CURRENT = Dimension(current=1)
VOLTAGE = Dimension(voltage=1)
TEMPERATURE = Dimension(temperature=1)
POWER = CURRENT.times(VOLTAGE)
FORCE = POWER.times(TIME).over(LENGTH)
MASS = FORCE.times(TIME.power(2)).over(LENGTH)

_PI = Fraction("3.14159265358979323846264338327950288419716939937510582097494459")
_NEWTON = Fraction(1, 1000)  # 1 W*s/m, in A*V*s/mm
_KILOGRAM = _NEWTON / 1000  # 1 N*s^2/m, in A*V*s^3/mm^2

BASE_UNITS: dict[str, tuple[Dimension, Fraction]] = {
    "mm": (LENGTH, Fraction(1)),
    "cm": (LENGTH, Fraction(10)),
    "m": (LENGTH, Fraction(1000)),
    "inch": (LENGTH, Fraction(254, 10)),
    "ft": (LENGTH, Fraction(3048, 10)),
    "ms": (TIME, Fraction(1, 1000)),
    "s": (TIME, Fraction(1)),
    "min": (TIME, Fraction(60)),
    "Hz": (TIME.power(-1), Fraction(1)),
    "deg": (ANGLE, Fraction(1)),
    "rad": (ANGLE, 180 / _PI),
    "g": (MASS, _KILOGRAM / 1000),
    "kg": (MASS, _KILOGRAM),
    "N": (FORCE, _NEWTON),
    "mA": (CURRENT, Fraction(1, 1000)),
    "A": (CURRENT, Fraction(1)),
    "Ah": (CURRENT.times(TIME), Fraction(3600)),
    "mV": (VOLTAGE, Fraction(1, 1000)),
    "V": (VOLTAGE, Fraction(1)),
    "W": (POWER, Fraction(1)),
    "Wh": (POWER.times(TIME), Fraction(3600)),
    "degC": (TEMPERATURE, Fraction(1)),
    "percent": (NUMBER, Fraction(1, 100)),
}
"""The units by name. The grammar's patterns and the messages are made from this table."""


class Unit(NamedTuple):
    """A unit as written, its dimension, and its exact factor to base units (mm, s, deg, A, V, degC)."""

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


def common_units(dimension: Dimension) -> tuple[str, ...]:
    """Return up to three units of a dimension that people write, the base unit among them.

    Example:
        >>> common_units(LENGTH), common_units(LENGTH.over(TIME))
        (('mm', 'cm', 'm'), ('mm/s', 'm/s'))
    """
    names = [name for name, (of, _) in BASE_UNITS.items() if of == dimension]
    base = str(dimension)
    metric = re.sub(r"\bmm\b", "m", re.sub(r"\bdeg\b", "rad", base))
    return tuple(names[:3] or dict.fromkeys((base, metric)))


def readable_unit(dimension: Dimension) -> Unit:
    """Return the unit in which messages show values of a dimension.

    It is the base unit, or one with a name, `kg`, where the base unit is a product of many. That of numbers
    without a dimension is called `number`.

    Example:
        >>> readable_unit(MASS).text, readable_unit(LENGTH.over(TIME)).text, readable_unit(NUMBER).text
        ('kg', 'mm/s', 'number')
    """
    base, known = str(dimension), common_units(dimension)
    if dimension == NUMBER or base in known:
        return Unit(base, dimension, Fraction(1))
    return parse_unit(known[-1])


def nanoseconds(seconds: float) -> int:
    """Return a finite time in seconds as whole nanoseconds, rounded once (half to even)."""
    return round(Fraction(seconds) * 1_000_000_000)
