"""The kinds of values in a body, from which its reader and its JSON schema are made.

A field of a data class of `model.py` or `devices/` is declared with `entry`: its key in the TOML text, the
kind of its value, and its meaning. Lengths and the like are texts with a unit, as in the language:
`"360 mm"`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, NamedTuple

from colony.text.units import Dimension

NAME = "[A-Za-z_][A-Za-z0-9_]*"
"""The pattern of a name, as in the language."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """The values that are allowed, in base units; `low` itself is not if `is_open`."""

    low: float = -math.inf
    high: float = math.inf
    is_open: bool = False

    def contain(self, value: float) -> bool:
        """Return True if a value is allowed."""
        return (self.low < value if self.is_open else self.low <= value) and value <= self.high


ANY = Bounds()
NOT_NEGATIVE = Bounds(low=0.0)
POSITIVE = Bounds(low=0.0, is_open=True)


@dataclass(frozen=True, slots=True)
class Measure:
    """A quantity: a text with a unit, or a number if it has no dimension. Read as a float in base units.

    `example` is a text for hints.
    """

    dimension: Dimension
    example: str
    bounds: Bounds = ANY


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
class Word:
    """One of several words."""

    words: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Text:
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
class Row:
    """An array with a kind for each place, read as an instance of the named tuple `type`."""

    items: tuple[Kind, ...]
    type: Callable[..., Any]


@dataclass(frozen=True, slots=True)
class Table:
    """A table, read as an instance of a data class whose fields are declared with `entry`."""

    type: type


@dataclass(frozen=True, slots=True)
class OneOf:
    """A table of one of several data classes, which its key `tag` names."""

    tag: str
    types: tuple[tuple[str, type], ...]


@dataclass(frozen=True, slots=True)
class Named:
    """A table of tables of one kind by name, read as a dictionary."""

    item: Kind


@dataclass(frozen=True, slots=True)
class Options:
    """The keys of the table that are not fields: texts, numbers and bools, read as a dictionary."""


Kind = Measure | AnyAmount | Interval | Whole | Word | Text | Many | Row | Table | OneOf | Named | Options


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
