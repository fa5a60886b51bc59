"""The description that a server gives of itself, so that programs can bind to it.

Examples of such bindings: `sensor level : number from Battery.level`, and
`actuator lift { height : mm range 0 .. 400 } to Lift.move`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import msgspec

from colony.ir.servers import CommandSpec, FieldSpec, ParameterSpec, ServerSpec
from colony.ir.types import BOOL, Array, Enum, Quantity, Scalar, Type
from colony.runtime.library.ask import Ask
from colony.runtime.protocol.calls import NoArguments
from colony.runtime.protocol.messages import Right
from colony.text.units import NUMBER, parse_unit


class FieldDescription(msgspec.Struct, frozen=True, kw_only=True):
    """A field of the server's frames: a number in `unit` (plain if ""), a bool, or `size` of them.

    With `has_age`, its readings say how old they are. `declared` is the unit of bare numbers that are given
    for it: that of the interface, or `unit` if "".
    """

    name: str
    kind: Literal["bool", "number"]
    unit: str = ""
    size: int | None = None
    meaning: str = ""
    has_age: bool = False
    declared: str = ""


class ParameterDescription(msgspec.Struct, frozen=True, kw_only=True):
    """A parameter of a command: a number in `unit` from `low` to `high`, a bool, or a member's number."""

    name: str
    kind: Literal["bool", "number", "enum"]
    unit: str = ""
    low: float | None = None
    high: float | None = None
    members: Mapping[str, float] = {}
    meaning: str = ""


class CommandDescription(msgspec.Struct, frozen=True, kw_only=True):
    """A command of the server, to which actuators can be bound."""

    name: str
    parameters: tuple[ParameterDescription, ...]


class MethodDescription(msgspec.Struct, frozen=True, kw_only=True):
    """A method of the server, and the right that it needs."""

    name: str
    right: Right


class Description(msgspec.Struct, frozen=True, kw_only=True):
    """The fields, the commands and the methods of a server."""

    server: str
    fields: tuple[FieldDescription, ...] = ()
    commands: tuple[CommandDescription, ...] = ()
    methods: tuple[MethodDescription, ...] = ()


def describe() -> Ask[Description]:
    """Read the fields, commands and methods of a server made with the kit."""
    return Ask("describe", NoArguments(), Description, "read", repeatable=True)


def server_spec(description: Description) -> ServerSpec:
    """Return the server's interface in the form that `bind` takes.

    Raises:
        ValueError: a unit is invalid, or not a base unit; fields are in mm, s, deg, A, V and degC.
    """
    fields = tuple(
        FieldSpec(f.name, field_type(f), f.meaning, has_age=f.has_age, declared=f.declared)
        for f in description.fields
    )
    commands = tuple(CommandSpec(c.name, tuple(map(_parameter, c.parameters))) for c in description.commands)
    return ServerSpec(description.server, fields=fields, commands=commands)


def _parameter(parameter: ParameterDescription) -> ParameterSpec:
    type_ = parameter_type(parameter)
    return ParameterSpec(parameter.name, type_, parameter.meaning, low=parameter.low, high=parameter.high)


def parameter_type(parameter: ParameterDescription) -> Scalar:
    """Return the type of a parameter.

    Raises:
        ValueError: the unit is invalid, or not a base unit.
    """
    match parameter.kind:
        case "bool":
            return BOOL
        case "number":
            return _quantity(parameter.name, parameter.unit)
        case "enum":
            return Enum(parameter.name, tuple(parameter.members.items()))


def field_type(field: FieldDescription) -> Type:
    """Return the type of a field.

    Raises:
        ValueError: the unit is invalid, or not a base unit.
    """
    element: Scalar = BOOL if field.kind == "bool" else _quantity(field.name, field.unit)
    return element if field.size is None else Array(element, field.size)


def in_base_units(unit_text: str) -> tuple[str, float]:
    """Return the base unit of the same dimension ("" for a plain number), and the factor to it.

    Raises:
        ValueError: the unit is invalid.
    """
    if not unit_text:
        return "", 1.0
    unit = parse_unit(unit_text)
    return "" if unit.dimension == NUMBER else str(unit.dimension), float(unit.factor)


def _quantity(name: str, unit_text: str) -> Quantity:
    if not unit_text:
        return Quantity(NUMBER)
    unit = parse_unit(unit_text)
    if unit.factor != 1:
        raise ValueError(f"{name}: the unit `{unit_text}`; expected base units: mm, s, deg, A, V, degC")
    return Quantity(unit.dimension)
