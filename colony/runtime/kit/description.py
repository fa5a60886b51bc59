"""The description that a server gives of itself, so that programs can bind to it.

An example of such a binding: `sensor level: number from Battery.level`.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from colony.ir.types import BOOL, Array, Quantity, Scalar, Type
from colony.runtime.library.ask import Ask
from colony.runtime.protocol.calls import NoArguments
from colony.runtime.protocol.fields import FieldSpec, ServerSpec
from colony.runtime.protocol.messages import Right
from colony.text.units import NUMBER, parse_unit


class FieldDescription(msgspec.Struct, frozen=True, kw_only=True):
    """A field of the server's frames: a number in `unit` (plain if ""), a bool, or `size` of them.

    With `has_age`, its readings say how old they are.
    """

    name: str
    kind: Literal["bool", "number"]
    unit: str = ""
    size: int | None = None
    meaning: str = ""
    has_age: bool = False


class MethodDescription(msgspec.Struct, frozen=True, kw_only=True):
    """A method of the server, and the right that it needs."""

    name: str
    right: Right


class Description(msgspec.Struct, frozen=True, kw_only=True):
    """The fields and the methods of a server."""

    server: str
    fields: tuple[FieldDescription, ...] = ()
    methods: tuple[MethodDescription, ...] = ()


def describe() -> Ask[Description]:
    """Read the fields and methods of a server made with the kit."""
    return Ask("describe", NoArguments(), Description, "read", repeatable=True)


def server_spec(description: Description) -> ServerSpec:
    """Return the server's interface in the form that `bind` takes.

    Raises:
        ValueError: a unit is invalid, or not a base unit; fields are in mm, s, deg, A, V and degC.
    """
    fields = tuple(FieldSpec(f.name, field_type(f), f.meaning, has_age=f.has_age) for f in description.fields)
    return ServerSpec(description.server, fields=fields)


def field_type(field: FieldDescription) -> Type:
    """Return the type of a field.

    Raises:
        ValueError: the unit is invalid, or not a base unit.
    """
    element: Scalar = BOOL
    if field.kind == "number":
        dimension = NUMBER
        if field.unit:
            unit = parse_unit(field.unit)
            if unit.factor != 1:
                raise ValueError(
                    f"{field.name}: the unit `{field.unit}`; expected base units: mm, s, deg, A, V, degC"
                )
            dimension = unit.dimension
        element = Quantity(dimension)
    return element if field.size is None else Array(element, field.size)
