"""Fields of a server written with the kit: what is declared of them, and how they are read in each frame.

    scans = Lidar("/dev/ttyUSB0")  # reads the device in a thread of its own
    field("scan", scans.newest, unit="mm", size=360, has_age=True)

`scans.newest` returns `Reading(ranges, time.monotonic_ns() - arrived_ns)`: the newest scan and its age. The
server stamps the reading, so a sensor `within 300 ms` goes missing when the thread dies and the scan gets
older. A field without an age counts as measured in each frame.
"""

from __future__ import annotations

import re
import reprlib
from collections.abc import Callable, Iterable
from operator import index
from typing import NamedTuple

from colony.execute.intake import as_float
from colony.ir.types import MAX_ELEMENTS, Value
from colony.runtime.frames.publishing import Fields
from colony.runtime.kit.description import FieldDescription, field_type, in_base_units
from colony.runtime.kit.once import OnceReporter, Report, failure_text
from colony.runtime.protocol.messages import Sample
from colony.runtime.servers.drivers import Reading

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
