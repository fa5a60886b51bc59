"""Types of the language: bools, quantities with a dimension, enums, and arrays of these.

At run time a quantity and an enumerator are a float (in base units), a bool is a bool, an array a tuple.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, assert_never

from colony.ir.bearings import Bearings
from colony.text.units import ANGLE, LENGTH, NUMBER, TIME, Dimension, Unit, parse_unit, readable_unit

MAX_ELEMENTS = 4096
"""Maximum number of elements of an array."""


@dataclass(frozen=True, slots=True)
class Bool:
    """The type of true and false."""

    def __str__(self) -> str:
        """Return the type's name."""
        return "bool"


@dataclass(frozen=True, slots=True)
class Quantity:
    """A 64-bit float with a dimension; `wildcard` marks the type of a literal `0`, which fits all of them.

    `written` sets apart numbers without a dimension: those in percent, and those written without a unit. They
    are not mixed. Types that differ only in it are equal.
    """

    dimension: Dimension = NUMBER
    wildcard: bool = False
    written: Literal["", "percent", "literal"] = field(default="", compare=False, repr=False)

    def __str__(self) -> str:
        """Return the dimension as a unit in base units."""
        return str(self.dimension)


@dataclass(frozen=True, slots=True)
class Enum:
    """An enum or a machine's phases; each member is represented by its number."""

    name: str
    members: tuple[tuple[str, float], ...]
    kind: Literal["enum", "machine"] = "enum"

    def __str__(self) -> str:
        """Return the enum's name."""
        return self.name


Scalar = Bool | Quantity | Enum


@dataclass(frozen=True, slots=True)
class Array:
    """The type of `size` elements, at least one, of a scalar type.

    `bearings` are the directions along which the elements look, if they have any. Types that differ only in
    them are equal: what an expression means is resolved when it is checked.
    """

    element: Scalar
    size: int
    bearings: Bearings | None = field(default=None, compare=False, repr=False)

    @property
    def closes(self) -> bool:
        """Return True for a ring that closes, whose plain indices wrap."""
        return self.bearings is not None and self.bearings.closes

    def __str__(self) -> str:
        """Return the type as written: `element[size]`."""
        return f"{self.element}[{self.size}]"


Type = Scalar | Array

BOOL = Bool()
DIMENSIONLESS = Quantity()
ZERO = Quantity(NUMBER, wildcard=True)
LITERAL = Quantity(written="literal")
DISTANCE = Quantity(LENGTH)
DURATION = Quantity(TIME)
DEGREES = Quantity(ANGLE)

ScalarValue = float | bool
Value = ScalarValue | tuple[ScalarValue, ...]


def element_type(type_: Type) -> Scalar:
    """Return the type of one element of an array, or the scalar type itself."""
    return type_.element if isinstance(type_, Array) else type_


def type_text(type_: Type) -> str:
    """Return a type as messages show it: a quantity by its readable unit."""
    element = element_type(type_)
    if not isinstance(element, Quantity):
        return str(type_)
    unit = unit_shown(element).text
    return f"{unit}[{type_.size}]" if isinstance(type_, Array) else unit


def bearings_of(type_: Type) -> Bearings | None:
    """Return the bearings of an array that has them."""
    return type_.bearings if isinstance(type_, Array) else None


def in_unit(unit: Unit) -> Quantity:
    """Return the type of values that are declared or written in a unit."""
    return Quantity(unit.dimension, written="percent" if unit.text == "percent" else "")


def is_percent(type_: Type) -> bool:
    """Return True for values in percent, and arrays of these."""
    element = element_type(type_)
    return isinstance(element, Quantity) and element.written == "percent"


def unit_shown(type_: Quantity) -> Unit:
    """Return the unit in which messages show values of a type."""
    return parse_unit("percent") if is_percent(type_) else readable_unit(type_.dimension)


def is_rate(type_: Scalar) -> bool:
    """Return True for speeds and rates: time is in the denominator of the unit."""
    return isinstance(type_, Quantity) and type_.dimension.time < 0


def in_shape_of(element: Scalar, like: Type) -> Type:
    """Return `element`, or an array of it with size and bearings of `like` if that is an array."""
    return replace(like, element=element) if isinstance(like, Array) else element


def any_value(type_: Scalar) -> ScalarValue:
    """Return some value of a type: false, the first enumerator, or 0."""
    match type_:
        case Bool():
            return False
        case Enum(members=members):
            return members[0][1]
        case Quantity():
            return 0.0
        case _:
            assert_never(type_)
