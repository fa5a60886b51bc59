"""The kinds of values in a body, from which its reader and its JSON schema are made.

A field of a data class of `model.py` or `devices/` is declared with `entry`: its key in the TOML text, the
kind of its value, and its meaning. Lengths and the like are texts with a unit, as in the language:
`"360 mm"`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, fields
from fractions import Fraction
from typing import Any, NamedTuple

from colony.text.units import NUMBER, Dimension, Unit, UnitError, common_units, parse_unit, readable_unit
from colony.text.wording import listed

NAME = "[A-Za-z_][A-Za-z0-9_]*"
"""The pattern of a name, as in the language."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AllowedRange:
    """The values that are allowed, in base units; `low` itself is not if `is_open`."""

    low: float = -math.inf
    high: float = math.inf
    is_open: bool = False

    def contain(self, value: float) -> bool:
        """Return True if a value is allowed."""
        return (self.low < value if self.is_open else self.low <= value) and value <= self.high


ANY = AllowedRange()
NOT_NEGATIVE = AllowedRange(low=0.0)
POSITIVE = AllowedRange(low=0.0, is_open=True)


@dataclass(frozen=True, slots=True)
class Measure:
    """A quantity: a text with a unit, or a number if it has no dimension. Read as a float in base units.

    `example` is a text for hints.
    """

    dimension: Dimension
    example: str
    bounds: AllowedRange = ANY


class Amount(NamedTuple):
    """A value of a body of any type: a number in base units with its dimension, a bool, or a name.

    `unit` is the unit as written; "" for none.
    """

    value: float | bool | str
    dimension: Dimension
    unit: str = ""


@dataclass(frozen=True, slots=True)
class AnyAmount:
    """A quantity of any dimension, a bool or a name, read as an `Amount`. `example` is a text for hints."""

    example: str


@dataclass(frozen=True, slots=True)
class Interval:
    """An interval, `"150 deg .. 165 deg"`, read as a pair of floats in base units."""

    dimension: Dimension
    example: str


@dataclass(frozen=True, slots=True)
class Whole:
    """A whole number from `low` to `high`."""

    low: int
    high: int


@dataclass(frozen=True, slots=True)
class WordKind:
    """One of several words."""

    words: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Flag:
    """True or false."""


@dataclass(frozen=True, slots=True)
class TextKind:
    """A text that matches a pattern as a whole; `form` describes it in messages."""

    pattern: str
    form: str


@dataclass(frozen=True, slots=True)
class Many:
    """An array of `least` to `most` items of one kind, read as a tuple."""

    item: Kind
    least: int
    most: int


@dataclass(frozen=True, slots=True)
class FixedArray:
    """An array with a kind for each place, read as an instance of the named tuple `type`."""

    items: tuple[Kind, ...]
    type: Callable[..., Any]


@dataclass(frozen=True, slots=True)
class TableKind:
    """A table, read as an instance of a data class whose fields are declared with `entry`."""

    type: type


@dataclass(frozen=True, slots=True)
class OneOf:
    """A table of one of several data classes, which its key `tag` names."""

    tag: str
    types: tuple[tuple[str, type], ...]


@dataclass(frozen=True, slots=True)
class NamedTables:
    """A table of tables of one kind by name, read as a dictionary."""

    item: Kind


@dataclass(frozen=True, slots=True)
class FreeKeys:
    """The keys of the table that are not fields: texts, numbers and bools, read as a dictionary."""


Kind = (
    Measure
    | AnyAmount
    | Interval
    | Whole
    | WordKind
    | Flag
    | TextKind
    | Many
    | FixedArray
    | TableKind
    | OneOf
    | NamedTables
    | FreeKeys
)


class Entry(NamedTuple):
    """A field of a data class as a body writes it; it is required if it has no default."""

    attribute: str
    key: str
    kind: Kind
    meaning: str
    is_required: bool


def entry(key: str, kind: Kind, meaning: str, *, default: Any = MISSING) -> Any:
    """Return a field of a data class, with its key, kind and meaning; without a default it is required."""
    metadata = {"key": key, "kind": kind, "meaning": meaning}
    if isinstance(default, dict):
        return field(default_factory=dict, metadata=metadata)
    return field(metadata=metadata) if default is MISSING else field(default=default, metadata=metadata)


def entries(type_: type) -> tuple[Entry, ...]:
    """Return the entries of a data class, in order."""
    return tuple(
        Entry(
            f.name,
            f.metadata["key"],
            f.metadata["kind"],
            f.metadata["meaning"],
            f.default is MISSING and f.default_factory is MISSING,
        )
        for f in fields(type_)
    )


# --- quantities ---------------------------------------------------------------------------------------
#
# Quantities in a body's texts: `"360 mm"`, `"150 deg .. 165 deg"`.

MAX_LENGTH = 100
"""Maximum number of characters of a quantity."""

SMALLEST, LARGEST = 1e-9, 1e9
"""Limits of the magnitude of a quantity other than 0, in base units."""

NUMBER_PATTERN = r"[+-]?[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]{1,3})?"
_QUANTITY = re.compile(rf"\s*({NUMBER_PATTERN})\s*(\S*)\s*")


class RejectedText(NamedTuple):
    """Why a text is no such quantity: its code, what was found and expected, and a hint."""

    code: str
    message: str
    hint: str | None


def parse_quantity(text: str, dimension: Dimension, example: str) -> float | RejectedText:
    """Return a quantity in base units, rounded once, or the problem; `example` is for the hint."""
    parts = _parts(text, example)
    return parts if isinstance(parts, RejectedText) else _in_base_units(*parts, dimension, example)


def parse_amount(text: str, example: str) -> Amount | RejectedText:
    """Return a quantity of any dimension, or a name, or the problem; `example` is for the hint."""
    if re.fullmatch(NAME, text):
        return Amount(text, NUMBER)
    parts = _parts(text, example)
    if isinstance(parts, RejectedText):
        return parts
    try:
        dimension = parse_unit(parts[1]).dimension if parts[1] else NUMBER
    except UnitError as problem:
        return RejectedText("B007", str(problem), _such_as(example))
    value = _in_base_units(*parts, dimension, example)
    return value if isinstance(value, RejectedText) else Amount(value, dimension, parts[1])


def parse_interval(text: str, dimension: Dimension, example: str) -> tuple[float, float] | RejectedText:
    """Return the ends of `LOW .. HIGH` in base units, or the problem; a unit after HIGH alone is for both."""
    ends = text.split("..")
    if len(ends) != 2:
        return RejectedText("B006", f"found `{text[:MAX_LENGTH]}`; expected `LOW .. HIGH`", _such_as(example))
    first, last = _parts(ends[0], example), _parts(ends[1], example)
    if isinstance(first, RejectedText):
        return first
    if isinstance(last, RejectedText):
        return last
    low = _in_base_units(first[0], first[1] or last[1], dimension, example)
    high = _in_base_units(*last, dimension, example)
    if isinstance(low, RejectedText):
        return low
    return high if isinstance(high, RejectedText) else (low, high)


def unit_hint(dimension: Dimension, example: str) -> str:
    """Return a hint with the units of a dimension."""
    return f"expected {listed(common_units(dimension), 'or')}, such as `{example}`"


def _such_as(example: str) -> str:
    return f"write a text such as `{example}`"


def _parts(text: str, example: str) -> tuple[str, str] | RejectedText:
    """Return the number and the unit of a text."""
    found = _QUANTITY.fullmatch(text) if len(text) <= MAX_LENGTH else None
    if found is None:
        return RejectedText(
            "B006", f"found `{text[:MAX_LENGTH]}`; expected a number and a unit", _such_as(example)
        )
    return found[1], found[2]


def _in_base_units(number: str, unit_text: str, dimension: Dimension, example: str) -> float | RejectedText:
    if not unit_text:
        unit = Unit("", NUMBER, Fraction(1))
    else:
        try:
            unit = parse_unit(unit_text)
        except UnitError as problem:
            return RejectedText("B007", str(problem), unit_hint(dimension, example))
    if unit.dimension != dimension:
        found = f"found a value in `{unit_text}`" if unit_text else f"found `{number}` without a unit"
        message = f"{found}; expected one in {readable_unit(dimension).text}"
        return RejectedText("B007", message, unit_hint(dimension, example))
    try:
        value = float(Fraction(number) * unit.factor)
    except OverflowError:
        value = math.inf
    if value and not SMALLEST <= abs(value) <= LARGEST:
        found = "too large" if abs(value) > LARGEST else "too small"
        return RejectedText("B008", f"found `{number}`, which is {found}", None)
    return value
