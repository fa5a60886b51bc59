"""Values of one's own: constants, noise, and what is painted over the map."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, NamedTuple

from colony.body.devices.common import FIELD_NAME, POSITION, SIZE, Sensor
from colony.body.kinds import Amount, AnyAmount, Many, Named, Row, Table, Word, entry
from colony.ir.servers import FieldSpec
from colony.ir.types import BOOL, Enum, Scalar, in_unit
from colony.text.units import Unit

_AMOUNT = AnyAmount("20 percent")


class PaintedCircle(NamedTuple):
    """A circle of the map in which a field has another value; in mm."""

    x_mm: float
    y_mm: float
    radius_mm: float
    amount: Amount


class PaintedRectangle(NamedTuple):
    """A rectangle of the map, from one corner to the opposite one, in which a field has another value."""

    x0_mm: float
    y0_mm: float
    x1_mm: float
    y1_mm: float
    amount: Amount


@dataclass(frozen=True, slots=True, kw_only=True)
class ValueField:
    """A field of such a device."""

    amount: Amount = entry("value", _AMOUNT, "the value: a number with its unit, a bool, or one of `members`")
    members: tuple[str, ...] = entry(
        "members", Many(FIELD_NAME, 0, 100), "the members of an enum, numbered from 0", default=()
    )
    noise: Amount | None = entry("noise", _AMOUNT, "standard deviation of a reading", default=None)
    rectangles: tuple[PaintedRectangle, ...] = entry(
        "rectangles",
        Many(Row((POSITION, POSITION, POSITION, POSITION, _AMOUNT), PaintedRectangle), 0, 1000),
        "rectangles of the map: x and y of two opposite corners, and the value inside; the last one counts",
        default=(),
    )
    circles: tuple[PaintedCircle, ...] = entry(
        "circles",
        Many(Row((POSITION, POSITION, SIZE, _AMOUNT), PaintedCircle), 0, 1000),
        "circles of the map, over the rectangles: x, y, radius, and the value inside; the last one counts",
        default=(),
    )
    edge: Literal["sharp", "fading"] = entry(
        "edge",
        Word(("sharp", "fading")),
        "whether the value of a circle ends at its edge, or fades from its center to what is around it "
        "[default: sharp]",
        default="sharp",
    )

    @property
    def amounts(self) -> Iterator[tuple[str, Amount]]:
        """All values that it may have, each with its key."""
        yield "value", self.amount
        yield from (("rectangles", painted.amount) for painted in self.rectangles)
        yield from (("circles", painted.amount) for painted in self.circles)

    def type_named(self, name: str) -> Scalar:
        """Return the type of the field, which has this name."""
        match self.amount.value:
            case bool():
                return BOOL
            case str():
                return Enum(name, tuple((member, float(i)) for i, member in enumerate(self.members)))
            case _:
                return in_unit(Unit(self.amount.unit, self.amount.dimension, Fraction(1)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Values(Sensor):
    """Values of your own: constant, with noise, or painted over the map; scenarios change them."""

    values: Mapping[str, ValueField] = entry("values", Named(Table(ValueField)), "the fields by name")

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        meaning = "the value that the body describes"
        return tuple(FieldSpec(name, value.type_named(name), meaning) for name, value in self.values.items())
