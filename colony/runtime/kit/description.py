"""The description that a server gives of itself, so that programs can bind to it.

Examples of such bindings: `sensor level : number from Battery.level`, and
`actuator lift { height : mm range 0 .. 400 } to Lift.move`.
"""

from __future__ import annotations

import re
import reprlib
from collections.abc import Callable, Iterable, Mapping
from operator import index
from typing import Literal, NamedTuple

import msgspec

from colony.execute.intake import as_float
from colony.ir.servers import CommandSpec, FieldSpec, ParameterSpec, ServerSpec
from colony.ir.types import BOOL, MAX_ELEMENTS, Array, Enum, Quantity, Scalar, Type, Value
from colony.runtime.frames.publishing import Fields
from colony.runtime.kit.once import OnceReporter, Report, failure_text
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import NoArguments
from colony.runtime.protocol.messages import Right, Sample
from colony.runtime.servers.drivers import Reading
from colony.text.units import NUMBER, parse_unit

# --- description ---------------------------------------------------------------------------------------


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


def describe() -> CallRequest[Description]:
    """Read the fields, commands and methods of a server made with the kit."""
    return CallRequest("describe", NoArguments(), Description, "read", repeatable=True)


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


# --- fields --------------------------------------------------------------------------------------------
#
# Fields of a server written with the kit: what is declared of them, and how they are read in each frame.
#
# scans = Lidar("/dev/ttyUSB0")  # reads the device in a thread of its own
# field("scan", scans.newest, unit="mm", size=360, has_age=True)
#
# `scans.newest` returns `Reading(ranges, time.monotonic_ns() - arrived_ns)`: the newest scan and its age.
# The server stamps the reading, so a sensor `within 300 ms` goes missing when the thread dies and the scan
# gets older. A field without an age counts as measured in each frame.


MAX_AGE_NS = 1_000_000_000_000_000_000
"""Age in nanoseconds, about 30 years, up to which ages differ: older readings count as this old."""


class Field(NamedTuple):
    """A field of the frames: its description, and the function that reads it; None stands for no value.

    `factor` is the unit of the numbers that `read` returns, in the base unit of the description.
    """

    description: FieldDescription
    read: Callable[[], Value | Reading | None]
    factor: float = 1.0


def field(
    name: str,
    read: Callable[[], Value | Reading | None],
    *,
    unit: str = "",
    size: int | None = None,
    boolean: bool = False,
    meaning: str = "",
    has_age: bool = False,
) -> Field:
    """Return a field for a server: numbers in any unit of the language, or plain, or bools.

    The server sends the numbers in base units. A sensor may declare any unit of the same dimension.

    Args:
        name: the name of the field.
        read: called once in each frame; returns a value or, with `has_age`, a `Reading`; None for no value.
        unit: the unit of the numbers that `read` returns, such as "kg" or "percent"; "" for plain ones.
        size: the number of elements of an array; None for a single value.
        boolean: True for bools.
        meaning: a description for users.
        has_age: True if its readings say how old they are. Only such a field can be read `within` a time.

    Raises:
        ValueError: the name is none that a behavior can write, the size is not 1 to 4096, or the unit is
            invalid.
    """
    if not isinstance(name, str) or re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", name) is None:
        raise ValueError(f"found the field {name!r}; expected a name of letters, digits and `_`")
    if size is not None and (type(size) is not int or not 1 <= size <= MAX_ELEMENTS):
        raise ValueError(f"{name}: found the size {reprlib.repr(size)}; expected 1 to {MAX_ELEMENTS}")
    base_unit, factor = in_base_units(unit)
    description = FieldDescription(
        name=name,
        kind="bool" if boolean else "number",
        unit=base_unit,
        size=size,
        meaning=meaning,
        has_age=has_age,
    )
    field_type(description)
    return Field(description, read, factor)


class InvalidReadingError(Exception):
    """A reading that a field cannot have. Errors of one `kind` are reported once for each field."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


class FieldReader:
    """Reads the fields of a server for its frames. Mutable: remembers which problems it has reported.

    A field that cannot be read, or returns what it was not declared to return, has no value in that frame.
    Such a problem is reported when it occurs for the first time, and not in each frame.

    Raises:
        ValueError: two fields have one name.
    """

    def __init__(self, server: str, fields: Iterable[Field], report: Report) -> None:
        self._server = server
        self._fields = tuple(fields)
        names = [field.description.name for field in self._fields]
        twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
        if twice is not None:
            raise ValueError(f"{server}: found two fields `{twice}`")
        self._problems = OnceReporter(report)

    @property
    def descriptions(self) -> tuple[FieldDescription, ...]:
        """The descriptions of the fields."""
        return tuple(field.description for field in self._fields)

    @property
    def failing(self) -> tuple[str, ...]:
        """One line for each field that cannot be read now."""
        return self._problems.failing

    @property
    def opening(self) -> bool:
        """False: its fields are functions, and no device is opened."""
        return False

    def read(self, now_ns: int) -> Fields:
        """Return the fields at `now_ns`; None for those without a value."""
        samples = {field.description.name: self._sample(field, now_ns) for field in self._fields}
        self._problems.end_frame()
        return samples

    def _sample(self, field: Field, now_ns: int) -> Sample | None:
        name = field.description.name
        try:
            found = field.read()
            return None if found is None else sample(field, found, now_ns)
        except InvalidReadingError as problem:
            self._problems.report(name, problem.kind, f"{self._server}.{name} {problem}")
        except Exception as problem:
            text = failure_text(f"{self._server}.{name}", problem)
            self._problems.report(name, type(problem).__name__, text)
        return None


def sample(declared: Field, found: object, now_ns: int) -> Sample:
    """Return what a field returned at `now_ns`, as its server publishes it: in base units.

    Raises:
        InvalidReadingError: it is not what the field was declared to return.
    """
    if not declared.description.has_age:
        if isinstance(found, Reading):
            raise InvalidReadingError("kind", "returned a Reading; declare the field with has_age=True")
        return Sample(_value(declared, found), now_ns)
    if not isinstance(found, Reading):
        text = f"returned {reprlib.repr(found)}; expected Reading(value, age_ns), because it has an age"
        raise InvalidReadingError("kind", text)
    return Sample(_value(declared, found.value), now_ns - age_in_ns(found.age_ns))


def age_in_ns(age: object) -> int:
    """Return an age, at most `MAX_AGE_NS`.

    Raises:
        InvalidReadingError: it is no whole number, or below 0: a reading from the future.
    """
    try:
        if isinstance(age, bool):
            raise TypeError
        age_ns = index(age)  # type: ignore[arg-type]
    except TypeError:
        text = f"has an age of {reprlib.repr(age)}; expected whole nanoseconds"
        raise InvalidReadingError("type of age", text) from None
    if age_ns < 0:
        text = f"has an age of {reprlib.repr(age_ns)} ns: a reading from the future; expected 0 or more"
        raise InvalidReadingError("age", text)
    return min(age_ns, MAX_AGE_NS)


def _value(declared: Field, value: object) -> Value:
    """Return a value as numbers or bools of its own, so that nothing changes it afterwards."""
    size = declared.description.size
    if size is None:
        return _element(declared, value)
    if not isinstance(value, (list, tuple)):
        text = f"returned {reprlib.repr(value)}; expected a list or tuple of {size}"
        raise InvalidReadingError("type", text)
    if len(value) != size:
        raise InvalidReadingError("size", f"returned {len(value)} elements; expected {size}")
    return tuple([_element(declared, element) for element in value])


def _element(declared: Field, value: object) -> bool | float:
    if declared.description.kind == "bool":
        if not isinstance(value, bool):
            raise InvalidReadingError("type", f"returned {reprlib.repr(value)}; expected True or False")
        return value
    if isinstance(value, float) and value != value:
        raise InvalidReadingError("nan", "returned NaN; expected a number, or None where there is none")
    number = as_float(value)
    if number is None:
        raise InvalidReadingError("type", f"returned {reprlib.repr(value)}; expected a number")
    return number * declared.factor
