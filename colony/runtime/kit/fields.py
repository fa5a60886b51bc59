"""Fields of a server written with the kit: what is declared of them, and how they are read in each frame.

    scans = Lidar("/dev/ttyUSB0")  # reads the device in a thread of its own
    field("scan", scans.newest, unit="mm", size=360, has_age=True)

`scans.newest` returns `Reading(ranges, time.monotonic_ns() - arrived_ns)`: the newest scan and its age. The
server stamps the reading, so a sensor `within 300 ms` goes missing when the thread dies and the scan gets
older. A field without an age counts as measured in each frame.
"""

from __future__ import annotations

import reprlib
import traceback
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from operator import index
from typing import NamedTuple

from colony.execute.intake import as_float
from colony.ir.types import Value
from colony.runtime.frames.publishing import Fields
from colony.runtime.kit.description import FieldDescription, field_type
from colony.runtime.protocol.messages import Sample

Report = Callable[[str], None]

MAX_AGE_NS = 1_000_000_000_000_000_000
"""Age in nanoseconds, about 30 years, up to which ages differ: older readings count as this old."""


@dataclass(frozen=True, slots=True)
class Reading:
    """A measurement and its age: the nanoseconds since the device took it, at least 0."""

    value: Value
    age_ns: int


class Field(NamedTuple):
    """A field of the frames: its description, and the function that reads it; None stands for no value."""

    description: FieldDescription
    read: Callable[[], Value | Reading | None]


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
    """Return a field for a server: numbers in a base unit (mm, s, deg, A, V, degC, or plain), or bools.

    Args:
        name: the name of the field.
        read: called once in each frame; returns a value or, with `has_age`, a `Reading`; None for no value.
        unit: the unit of the numbers, which are plain if it is "".
        size: the number of elements of an array; None for a single value.
        boolean: True for bools.
        meaning: a description for users.
        has_age: True if its readings say how old they are. Only such a field can be read `within` a time.

    Raises:
        ValueError: the unit is invalid, or not a base unit.
    """
    description = FieldDescription(
        name=name,
        kind="bool" if boolean else "number",
        unit=unit,
        size=size,
        meaning=meaning,
        has_age=has_age,
    )
    field_type(description)
    return Field(description, read)


def exception_text(problem: BaseException) -> str:
    """Return the text of an exception that a user's function raised, also where that text fails itself."""
    try:
        return str(problem)
    except Exception:
        return "(an exception without a text)"


class InvalidReadingError(Exception):
    """A reading that a field cannot have. Errors of one `kind` are reported once for each field."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


class FieldReader:
    """Reads the fields of a server for its frames. Mutable: remembers which problems it has reported.

    A field that cannot be read, or returns what it was not declared to return, has no value in that frame.
    Such a problem is reported when it occurs for the first time, and not in each frame.
    """

    def __init__(self, server: str, fields: Iterable[Field], report: Report) -> None:
        self._server = server
        self._fields = tuple(fields)
        self._report = report
        self._reported: set[tuple[str, str]] = set()

    def read(self, now_ns: int) -> Fields:
        """Return the fields at `now_ns`; None for those without a value."""
        return {field.description.name: self._sample(field, now_ns) for field in self._fields}

    def _sample(self, field: Field, now_ns: int) -> Sample | None:
        try:
            found = field.read()
            return None if found is None else sample(field.description, found, now_ns)
        except InvalidReadingError as problem:
            self._report_once(field, problem.kind, f" {problem}")
        except Exception as problem:
            self._report_once(field, type(problem).__name__, f" failed:\n{traceback.format_exc()}")
        return None

    def _report_once(self, field: Field, kind: str, problem: str) -> None:
        name = field.description.name
        if (name, kind) not in self._reported:
            self._reported.add((name, kind))
            self._report(f"{self._server}.{name}{problem}")


def sample(declared: FieldDescription, found: object, now_ns: int) -> Sample:
    """Return what a field returned at `now_ns`, as its server publishes it.

    Raises:
        InvalidReadingError: it is not what the field was declared to return.
    """
    if not declared.has_age:
        if isinstance(found, Reading):
            raise InvalidReadingError("kind", "returned a Reading; declare the field with has_age=True")
        return Sample(_value(declared, found), now_ns)
    if not isinstance(found, Reading):
        text = f"returned {reprlib.repr(found)}; expected Reading(value, age_ns), because it has an age"
        raise InvalidReadingError("kind", text)
    return Sample(_value(declared, found.value), now_ns - _age_ns(found.age_ns))


def _age_ns(age: object) -> int:
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


def _value(declared: FieldDescription, value: object) -> Value:
    """Return a value as numbers or bools of its own, so that nothing changes it afterwards."""
    if declared.size is None:
        return _element(declared, value)
    if not isinstance(value, (list, tuple)):
        text = f"returned {reprlib.repr(value)}; expected a list or tuple of {declared.size}"
        raise InvalidReadingError("type", text)
    if len(value) != declared.size:
        raise InvalidReadingError("size", f"returned {len(value)} elements; expected {declared.size}")
    return tuple([_element(declared, element) for element in value])


def _element(declared: FieldDescription, value: object) -> bool | float:
    if declared.kind == "bool":
        if not isinstance(value, bool):
            raise InvalidReadingError("type", f"returned {reprlib.repr(value)}; expected True or False")
        return value
    if isinstance(value, float) and value != value:
        raise InvalidReadingError("nan", "returned NaN; expected a number, or None where there is none")
    number = as_float(value)
    if number is None:
        raise InvalidReadingError("type", f"returned {reprlib.repr(value)}; expected a number")
    return number
