"""The server of a device, with the fields and commands that the robot's body describes, over its driver.

What a driver gives is held to the description: an element without an echo reads `no_echo`, one that is
invalid keeps its last value and time or makes the array missing, and one that the robot's body blocks reads
`no_echo`. An array is as old as its oldest element.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

from colony.execute.intake import as_float
from colony.ir.servers import CommandSpec, FieldSpec, ParameterSpec, ServerSpec
from colony.ir.types import BOOL, Array, Bool, Enum, ScalarValue, Value, element_type, is_percent
from colony.runtime.frames.publishing import FRAMES_KEPT, Fields
from colony.runtime.kit.commands import Command, in_units
from colony.runtime.kit.description import (
    CommandDescription,
    FieldDescription,
    InvalidReadingError,
    ParameterDescription,
    age_in_ns,
)
from colony.runtime.kit.once import OnceReporter, Report, failure_text
from colony.runtime.kit.service import Service
from colony.runtime.protocol.deployment import Deployment
from colony.runtime.protocol.messages import Sample
from colony.runtime.servers.drivers import DeviceDriver, Reading, is_opening, problems_of, unreached_of
from colony.text.wording import listed


def device_server(
    spec: ServerSpec,
    driver: DeviceDriver,
    report: Report,
    *,
    deployment: Deployment | None = None,
    frames_kept: int = FRAMES_KEPT,
    is_expected: bool = False,
) -> Service:
    """Return the server of a device.

    Args:
        spec: its fields and commands.
        driver: the driver of the device.
        report: takes each problem of the driver, the first time that it occurs.
        deployment: the program that commands it from the start, if any.
        frames_kept: the number of frames that it keeps for readers that missed one.
        is_expected: True if the Clock knows the server, and listens to its frames.
    """
    return Service(
        spec.name,
        (),
        DeviceReader(spec, driver, report),
        report,
        commands=device_commands(spec, driver),
        deployment=deployment,
        frames_kept=frames_kept,
        is_expected=is_expected,
    )


NEVER_READ_NS = 10_000_000_000
"""Time in ns after which a field that a working device has never given is reported, once.

It is no failure: some fields, such as a goal in sight, are rarely given.
"""


class _Held(NamedTuple):
    """The last valid elements of an array, and when each was taken; None for one that never was."""

    values: list[ScalarValue | None]
    times: list[int]


class DeviceReader:
    """Reads the fields of a device for the frames of its server. Mutable: holds elements that were valid.

    A field that cannot be read, or that is not what the description says, has no value in that frame.
    """

    def __init__(self, spec: ServerSpec, driver: DeviceDriver, report: Report) -> None:
        self._spec = spec
        self._driver = driver
        self._report = report
        self._problems = OnceReporter(report)
        self._blocked = {field.name: frozenset(field.blocked) for field in spec.fields}
        self._held: dict[str, _Held] = {}
        self._never_read = [field.name for field in spec.fields if field.is_read]
        self._works_since_ns: int | None = None

    @property
    def descriptions(self) -> tuple[FieldDescription, ...]:
        """The descriptions of the fields."""
        return tuple(map(_field_description, self._spec.fields))

    @property
    def failing(self) -> tuple[str, ...]:
        """One line for each problem that the driver has now, or says that it has."""
        return (*problems_of(self._driver), *self._problems.failing)

    @property
    def opening(self) -> bool:
        """True while the device is being opened."""
        return is_opening(self._driver)

    def read(self, now_ns: int) -> Fields:
        """Return the fields at `now_ns`; None for those without a value."""
        fields = self._read(now_ns)
        if self._never_read:
            self._look_for_fields(fields, now_ns)
        self._problems.end_frame()
        return fields

    def _look_for_fields(self, fields: Fields, now_ns: int) -> None:
        """Report the fields that a sensor reads and a working device has never given."""
        self._never_read = [name for name in self._never_read if fields.get(name) is None]
        if problems_of(self._driver) or self.opening:
            self._works_since_ns = None
        elif self._works_since_ns is None:
            self._works_since_ns = now_ns
        elif now_ns - self._works_since_ns >= NEVER_READ_NS:
            for name in self._never_read:
                self._report(f"{self._spec.name}.{name} is missing: the driver has never given it a value")
            self._never_read = []

    def _read(self, now_ns: int) -> Fields:
        server = self._spec.name
        try:
            found = self._driver.fields()
            if not isinstance(found, Mapping):
                raise TypeError(f"returned {reprlib.repr(found)}; expected the readings by name")
            readings = {field.name: found.get(field.name) for field in self._spec.fields}
            unknown = found.keys() - self._blocked.keys()
        except (Exception, SystemExit) as problem:
            text = failure_text(f"fields of {server}", problem)
            self._problems.report("", type(problem).__name__, text)
            return dict.fromkeys(self._blocked)
        for name in unknown:
            text = f"{server}.{name} is no field of the description"
            self._problems.report(str(name), "unknown", text)
        return {field.name: self._sample(field, readings[field.name], now_ns) for field in self._spec.fields}

    def _sample(self, field: FieldSpec, found: object, now_ns: int) -> Sample | None:
        try:
            if found is None:
                return None
            if not isinstance(found, Reading):
                text = f"is {reprlib.repr(found)}; expected Reading(value, age_ns)"
                raise InvalidReadingError("kind", text)
            taken_ns = now_ns - age_in_ns(found.age_ns)
            if isinstance(field.type, Array):
                return self._array(field, field.type, found.value, taken_ns)
            is_without_echo = found.value == math.inf and field.no_echo is not None
            return Sample(_valid(field, field.no_echo if is_without_echo else found.value), taken_ns)
        except InvalidReadingError as problem:
            self._problems.report(field.name, problem.kind, f"{self._spec.name}.{field.name} {problem}")
        except Exception as problem:  # a reading of the driver's own class may raise when it is looked at
            text = failure_text(f"{self._spec.name}.{field.name}", problem)
            self._problems.report(field.name, type(problem).__name__, text)
        return None

    def _array(self, field: FieldSpec, type_: Array, value: object, taken_ns: int) -> Sample | None:
        if not isinstance(value, (list, tuple)):
            text = f"is {reprlib.repr(value)}; expected a list or tuple of {type_.size}"
            raise InvalidReadingError("type", text)
        if len(value) != type_.size:
            text = f"has {len(value)} elements; expected {type_.size}"
            is_one_more = len(value) == type_.size + 1
            text += "; leave out the last one if it repeats the first" if is_one_more else ""
            raise InvalidReadingError("size", text)
        blocked, no_echo = self._blocked[field.name], field.no_echo
        if no_echo is None and (infinite := next(filter(_is_infinite, value), None)) is not None:
            at = f"is inf in element {value.index(infinite)}"
            text = (
                f"{self._spec.name}.{field.name} {at}, which counts as invalid: the body gives no `no_echo`"
            )
            self._problems.report(field.name, "no echo", text)
        elements = None if blocked else _floats(field, type_, value)
        if elements is None:
            elements = [
                no_echo if i in blocked else _element(field, element) for i, element in enumerate(value)
            ]
        if field.hold:
            return self._with_held(field.name, elements, taken_ns)
        return None if None in elements else Sample(_value(elements), taken_ns)

    def _with_held(self, name: str, elements: list[ScalarValue | None], taken_ns: int) -> Sample | None:
        """Return an array whose invalid elements have their last values; as old as the oldest element."""
        held = self._held.get(name)
        if held is None:
            held = self._held[name] = _Held([None] * len(elements), [taken_ns] * len(elements))
        for i, element in enumerate(elements):
            if element is not None:
                held.values[i], held.times[i] = element, taken_ns
        return None if None in held.values else Sample(_value(held.values), min(held.times))


def _value(elements: list[ScalarValue | None]) -> Value:
    return tuple(elements)  # type: ignore[arg-type]  # none of them is None


def _floats(
    field: FieldSpec, type_: Array, value: list[object] | tuple[object, ...]
) -> list[ScalarValue | None] | None:
    """Return the elements of an array of valid floats, the usual case, quickly; None for all other arrays."""
    if set(map(type, value)) != {float} or type_.element == BOOL or isinstance(type_.element, Enum):
        return None
    numbers: list[float] = value  # type: ignore[assignment]  # as was checked
    factor, infinite = field.factor, math.inf
    if not math.isfinite(sum([number * factor for number in numbers if number != infinite])):
        return None
    return [field.no_echo if number == infinite else number * factor for number in numbers]


def _element(field: FieldSpec, element: object) -> ScalarValue | None:
    """Return an element; what an echo that is missing reads, or None if the element is invalid."""
    if element is None or (isinstance(element, float) and element != element):
        return None
    return field.no_echo if _is_infinite(element) else _valid(field, element)


def _is_infinite(element: object) -> bool:
    """Return True for an element without an echo."""
    return isinstance(element, float) and element == math.inf


def _valid(field: FieldSpec, value: object) -> ScalarValue:
    element = element_type(field.type)
    if element == BOOL:
        if not isinstance(value, bool):
            raise InvalidReadingError("type", f"is {reprlib.repr(value)}; expected True or False")
        return value
    number = as_float(value)
    if number is None or not math.isfinite(number * field.factor):
        raise InvalidReadingError("type", f"is {reprlib.repr(value)}; expected a finite number")
    if isinstance(element, Enum) and number not in dict(element.members).values():
        members = listed([f"{n:g} ({name})" for name, n in element.members], "or")
        raise InvalidReadingError("member", f"is {reprlib.repr(value)}; expected {members}")
    return number * field.factor


# --- commands and descriptions ----------------------------------------------------------------------


def device_commands(spec: ServerSpec, driver: DeviceDriver) -> tuple[Command, ...]:
    """Return the commands of a device's server, which its driver carries out."""
    return tuple(_command(command, driver) for command in spec.commands)


def _command(spec: CommandSpec, driver: DeviceDriver) -> Command:
    factors = {parameter.name: parameter.factor for parameter in spec.parameters}

    def perform(**values: ScalarValue) -> None:
        driver.command(spec.name, values)

    def is_explained() -> bool:
        return is_opening(driver) or bool(problems_of(driver))

    parameters = tuple(map(_parameter_description, spec.parameters))
    return Command(
        CommandDescription(name=spec.name, parameters=parameters),
        in_units(perform, factors),
        partial(driver.safe),
        partial(unreached_of, driver),
        is_explained,
    )


def _field_description(spec: FieldSpec) -> FieldDescription:
    element = element_type(spec.type)
    is_bool = isinstance(element, Bool)
    return FieldDescription(
        name=spec.name,
        kind="bool" if is_bool else "number",
        unit="" if is_bool or isinstance(element, Enum) or str(element) == "number" else str(element),
        size=spec.type.size if isinstance(spec.type, Array) else None,
        meaning=spec.meaning,
        has_age=spec.has_age,
        declared=spec.declared or ("percent" if is_percent(element) else ""),
    )


def _parameter_description(spec: ParameterSpec) -> ParameterDescription:
    match spec.type:
        case Bool():
            return ParameterDescription(name=spec.name, kind="bool", meaning=spec.meaning)
        case Enum(members=members):
            return ParameterDescription(
                name=spec.name, kind="enum", members=dict(members), meaning=spec.meaning
            )
        case _:
            return ParameterDescription(
                name=spec.name,
                kind="number",
                unit="" if str(spec.type) == "number" else str(spec.type),
                low=spec.low,
                high=spec.high,
                meaning=spec.meaning,
            )
