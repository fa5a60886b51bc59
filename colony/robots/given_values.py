"""Values of sensors that people give as texts: of `--set`, and of scenarios."""

from __future__ import annotations

import math
import re

from colony.ir.fitting import name_hint
from colony.ir.program import Robot, Sensor
from colony.ir.servers import DSERVER, FieldSpec
from colony.ir.types import (
    Array,
    Bool,
    Enum,
    Quantity,
    Scalar,
    ScalarValue,
    Value,
    element_type,
    in_unit,
    is_percent,
)
from colony.text.units import BASE_UNITS, NUMBER, Dimension, UnitError, common_units, parse_unit
from colony.text.wording import counted, did_you_mean, listed, shortened

_QUANTITY = re.compile(r"([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*(.*)")


class GivenValueError(ValueError):
    """A name or value is invalid; the message has what was found and what was expected."""


class UnknownSensorError(GivenValueError):
    """No sensor of the program has this name."""


def sensor_named(robot: Robot, name: str) -> Sensor:
    """Return the sensor with this name, the one that reads this variable of DServer, or this `SERVER.FIELD`.

    Raises:
        UnknownSensorError: the program has none.
    """
    sensors = [s for s in robot.sensors if s.sent is None]
    readers = {f"{s.server}.{s.field}": s for s in reversed(sensors)}
    readers |= {s.field: s for s in reversed(sensors) if s.server == DSERVER.name}
    readers |= {s.name: s for s in sensors}
    if name not in readers:
        raise UnknownSensorError(f"no sensor reads `{shortened(name)}`; {name_hint(name, readers)}")
    return readers[name]


def described_sensor(server: str, field: FieldSpec) -> Sensor:
    """Return the sensor of a field that a server describes, in its declared unit."""
    element, factor = element_type(field.type), 1.0
    if field.declared:
        unit = parse_unit(field.declared)
        element, factor = in_unit(unit), float(unit.factor)
    type_ = Array(element, field.type.size) if isinstance(field.type, Array) else element
    return Sensor(name=f"{server}.{field.name}", type=type_, factor=factor, server=server, field=field.name)


def parse_value(sensor: Sensor, text: str) -> Value:
    """Return what a sensor reads, in its declared unit.

    The text is a number, with or without a unit; true or false; an enumerator; or a list of such values:
    `[1, 2]`. One value fills an array.

    Raises:
        GivenValueError: the text is no value of the sensor's type.
    """
    if isinstance(sensor.type, Array):
        size, element = sensor.type.size, sensor.type.element
        if not text.startswith("["):
            return (_scalar(sensor, element, text),) * size
        if not text.endswith("]"):
            raise GivenValueError(f"found `{shortened(text)}`; expected a list of {size}")
        parts = [part.strip() for part in text[1:-1].split(",")] if text[1:-1].strip() else []
        if len(parts) != size:
            raise GivenValueError(f"found {counted(len(parts), 'value')}; expected {size}")
        return tuple(_scalar(sensor, element, part) for part in parts)
    return _scalar(sensor, sensor.type, text)


def _scalar(sensor: Sensor, type_: Scalar, text: str) -> ScalarValue:
    hint = None
    match type_:
        case Bool():
            if text in ("true", "false"):
                return text == "true"
            expected = "true or false"
        case Enum(name=name, members=members):
            numbers = dict(members)
            number = parse_number(text, Dimension(), 1.0)
            if text.removeprefix(f"{name}.") in numbers:
                return numbers[text.removeprefix(f"{name}.")]
            if number is not None and number in numbers.values():
                return number
            expected = "one of " + ", ".join(f"{name}.{member}" for member in numbers)
        case Quantity(dimension=dimension):
            value = parse_number(text, dimension, sensor.factor)
            if value is not None:
                return value
            units = ("percent",) if is_percent(type_) else common_units(dimension)
            expected = (
                "a number"
                if dimension == NUMBER and not is_percent(type_)
                else f"a number in {listed(units, 'or')}"
            )
            parts = _QUANTITY.fullmatch(text)
            if parts is not None and parts[2] not in BASE_UNITS:
                known = [name for name, (of, _) in BASE_UNITS.items() if of == dimension]
                hint = did_you_mean(parts[2], known, cutoff=0.75)
    raise GivenValueError(f"found `{shortened(text)}`; expected {expected}{f'; {hint}' if hint else ''}")


def parse_number(text: str, dimension: Dimension, factor: float) -> float | None:
    """Parse a number, with or without a unit of this dimension; return it in units of `factor` base units.

    Returns None for any other text, and for a number that is too large in either unit.
    """
    parts = _QUANTITY.fullmatch(text.strip())
    if parts is None:
        return None
    value = float(parts[1])
    if parts[2]:
        try:
            unit = parse_unit(parts[2])
        except UnitError:
            return None
        if unit.dimension != dimension:
            return None
        value = value * float(unit.factor) / factor
    return value if math.isfinite(value) and math.isfinite(value * factor) else None
