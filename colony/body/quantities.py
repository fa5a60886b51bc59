"""Quantities in a body's texts: `"360 mm"`, `"150 deg .. 165 deg"`."""

from __future__ import annotations

import math
import re
from fractions import Fraction
from typing import NamedTuple

from colony.body.kinds import NAME, Amount
from colony.text.units import NUMBER, Dimension, Unit, UnitError, common_units, parse_unit, readable_unit
from colony.text.wording import listed

MAX_LENGTH = 100
"""Maximum number of characters of a quantity."""

SMALLEST, LARGEST = 1e-9, 1e9
"""Limits of the magnitude of a quantity other than 0, in base units."""

NUMBER_PATTERN = r"[+-]?[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]{1,3})?"
_QUANTITY = re.compile(rf"\s*({NUMBER_PATTERN})\s*(\S*)\s*")


class Problem(NamedTuple):
    """Why a text is no such quantity: its code, what was found and expected, and a hint."""

    code: str
    message: str
    hint: str | None


def parse_quantity(text: str, dimension: Dimension, example: str) -> float | Problem:
    """Return a quantity in base units, rounded once, or the problem; `example` is for the hint."""
    parts = _parts(text, example)
    return parts if isinstance(parts, Problem) else _in_base_units(*parts, dimension, example)


def parse_amount(text: str, example: str) -> Amount | Problem:
    """Return a quantity of any dimension, or a name, or the problem; `example` is for the hint."""
    if re.fullmatch(NAME, text):
        return Amount(text, NUMBER)
    parts = _parts(text, example)
    if isinstance(parts, Problem):
        return parts
    try:
        dimension = parse_unit(parts[1]).dimension if parts[1] else NUMBER
    except UnitError as problem:
        return Problem("B007", str(problem), _such_as(example))
    value = _in_base_units(*parts, dimension, example)
    return value if isinstance(value, Problem) else Amount(value, dimension, parts[1])


def parse_interval(text: str, dimension: Dimension, example: str) -> tuple[float, float] | Problem:
    """Return the ends of `LOW .. HIGH` in base units, or the problem; a unit after HIGH alone is for both."""
    ends = text.split("..")
    if len(ends) != 2:
        return Problem("B006", f"found `{text[:MAX_LENGTH]}`; expected `LOW .. HIGH`", _such_as(example))
    first, last = _parts(ends[0], example), _parts(ends[1], example)
    if isinstance(first, Problem):
        return first
    if isinstance(last, Problem):
        return last
    low = _in_base_units(first[0], first[1] or last[1], dimension, example)
    high = _in_base_units(*last, dimension, example)
    if isinstance(low, Problem):
        return low
    return high if isinstance(high, Problem) else (low, high)


def unit_hint(dimension: Dimension, example: str) -> str:
    """Return a hint with the units of a dimension."""
    return f"expected {listed(common_units(dimension), 'or')}, such as `{example}`"


def _such_as(example: str) -> str:
    return f"write a text such as `{example}`"


def _parts(text: str, example: str) -> tuple[str, str] | Problem:
    """Return the number and the unit of a text."""
    found = _QUANTITY.fullmatch(text) if len(text) <= MAX_LENGTH else None
    if found is None:
        return Problem(
            "B006", f"found `{text[:MAX_LENGTH]}`; expected a number and a unit", _such_as(example)
        )
    return found[1], found[2]


def _in_base_units(number: str, unit_text: str, dimension: Dimension, example: str) -> float | Problem:
    if not unit_text:
        unit = Unit("", NUMBER, Fraction(1))
    else:
        try:
            unit = parse_unit(unit_text)
        except UnitError as problem:
            return Problem("B007", str(problem), unit_hint(dimension, example))
    if unit.dimension != dimension:
        found = f"found a value in `{unit_text}`" if unit_text else f"found `{number}` without a unit"
        message = f"{found}; expected one in {readable_unit(dimension).text}"
        return Problem("B007", message, unit_hint(dimension, example))
    try:
        value = float(Fraction(number) * unit.factor)
    except OverflowError:
        value = math.inf
    if value and not SMALLEST <= abs(value) <= LARGEST:
        found = "too large" if abs(value) > LARGEST else "too small"
        return Problem("B008", f"found `{number}`, which is {found}", None)
    return value
