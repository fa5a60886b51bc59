"""Values of sensors that people give as texts: of `--set`, and of scenarios."""

from __future__ import annotations

import math
import re

from colony.ir.fitting import name_hint
from colony.ir.program import Robot, Sensor
from colony.ir.servers import DSERVER
from colony.ir.types import Array, Bool, Enum, Quantity, Scalar, ScalarValue, Value
from colony.text.units import Dimension, UnitError, parse_unit, readable_unit
from colony.text.wording import counted, shortened

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


def parse_value(sensor: Sensor, text: str) -> Value:
    """Return what a sensor reads, in its declared unit.

    The text is a number, with or without a unit; true or false; an enumerator; or a list of such values:
    `[1, 2]`.

    Raises:
        GivenValueError: the text is no value of the sensor's type.
    """
    if isinstance(sensor.type, Array):
        if not (text.startswith("[") and text.endswith("]")):
            raise GivenValueError(f"found `{shortened(text)}`; expected a list of {sensor.type.size}")
        parts = [part.strip() for part in text[1:-1].split(",")] if text[1:-1].strip() else []
        if len(parts) != sensor.type.size:
            raise GivenValueError(f"found {counted(len(parts), 'value')}; expected {sensor.type.size}")
        element = sensor.type.element
        return tuple(_scalar(sensor, element, part) for part in parts)
    return _scalar(sensor, sensor.type, text)


def _scalar(sensor: Sensor, type_: Scalar, text: str) -> ScalarValue:
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
            expected = (
                f"a number in {readable_unit(dimension).text}" if dimension != Dimension() else "a number"
            )
    raise GivenValueError(f"found `{shortened(text)}`; expected {expected}")


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
