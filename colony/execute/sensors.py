"""Validation of sensors' readings, and stand-ins for missing ones."""

from __future__ import annotations

from colony.execute.intake import Records, clamped, take_bool, take_bools, take_number, take_numbers
from colony.ir.frame import Reading
from colony.ir.program import Sensor
from colony.ir.types import Array, Bool, Enum, Value, element_type


def stand_in(sensor: Sensor) -> Value:
    """Return the value that ops use if the sensor is missing: its default, or a placeholder.

    A placeholder lies within the sensor's range, so that facts derived from the range hold for it, too.
    """
    kind = element_type(sensor.type)
    if sensor.default is not None:
        value: Value = sensor.default
    elif isinstance(kind, Bool):
        value = False
    elif isinstance(kind, Enum):
        value = kind.members[0][1] if kind.members else 0.0
    else:
        value = clamped(0.0, sensor.low, sensor.high)
    if isinstance(sensor.type, Array) and not isinstance(value, tuple):
        return (value,) * sensor.type.size
    return value


def age_limits(sensors: tuple[Sensor, ...]) -> dict[str, int]:
    """Return the maximum age of readings, in ns, for each sensor that declares one."""
    return {s.name: s.within_ns for s in sensors if s.within_ns is not None}


def members(sensor: Sensor) -> tuple[float, ...] | None:
    """Return the numbers that a sensor of an enum type may have; None for other types."""
    kind = element_type(sensor.type)
    return tuple(number for _, number in kind.members) if isinstance(kind, Enum) else None


def validate_reading(sensor: Sensor, reading: Reading, records: Records) -> tuple[Value, bool, Records]:
    """Return the value of a sensor in base units or its stand-in, True if it is fresh, and all records."""
    name, otherwise = sensor.name, stand_in(sensor)
    factor, low, high = sensor.factor, sensor.low, sensor.high
    if isinstance(sensor.type, Array):
        assert isinstance(otherwise, tuple)
        size = sensor.type.size
        if isinstance(sensor.type.element, Bool):
            return take_bools(name, reading, size, otherwise, records)  # type: ignore[arg-type]
        return take_numbers(name, reading, size, factor, low, high, members(sensor), otherwise, records)
    assert not isinstance(otherwise, tuple)
    if isinstance(sensor.type, Bool):
        return take_bool(name, reading, bool(otherwise), records)
    return take_number(name, reading, factor, low, high, members(sensor), otherwise, records)
