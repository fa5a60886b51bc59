"""Validation of readings for an executor: checks, conversion, clamping, records.

Like those of `arithmetic`, these functions use only `math`, as the Python backend copies them into generated
programs. Each `take_` function returns the value (`otherwise` if the reading is missing or faulty), True if
the sensor is fresh, and the records, to which it may add one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf, nan

from colony.ir.frame import Reading
from colony.ir.program import Sensor
from colony.ir.types import Array, Bool, Enum, Value, element_type

# --- intake --------------------------------------------------------------------------------------------


Records = tuple[tuple[str, str], ...]


def of_age(
    t_ns: int, readings: Mapping[str, object], taken_ns: Mapping[str, int], within_ns: Mapping[str, int]
) -> dict[str, object]:
    """Return the readings of a frame at `t_ns`, without those that are older than `within_ns` allows.

    A reading taken after the frame becomes NaN, which is a fault for every sensor.
    """
    current = dict(readings)
    for name, taken in taken_ns.items():
        if name in current and taken > t_ns:
            current[name] = nan
        elif name in within_ns and t_ns - taken > within_ns[name]:
            current[name] = None
    return current


def as_float(reading: object) -> float | None:
    """Return an int or float as a float, infinite if it is too large for one; None for NaN and all else."""
    if isinstance(reading, bool) or not isinstance(reading, float | int) or reading != reading:
        return None
    try:
        return float(reading)
    except OverflowError:
        return inf if reading > 0 else -inf


def converted(reading: object, convert: Callable[[float], float]) -> object:
    """Convert a reading, or each element of an array; anything but a number is returned as it is."""
    if isinstance(reading, list | tuple):
        return tuple([converted(element, convert) for element in reading])
    number = as_float(reading)
    return reading if number is None else convert(number)


def clamped(value: float, low: float | None, high: float | None) -> float:
    """Return the value, or the bound that it exceeds."""
    if low is not None and value < low:
        return low
    if high is not None and value > high:
        return high
    return value


def take_bool(
    name: str, reading: object, otherwise: bool, records: tuple[tuple[str, str], ...]
) -> tuple[bool, bool, tuple[tuple[str, str], ...]]:
    """Take a bool."""
    if isinstance(reading, bool):
        return reading, True, records
    return otherwise, False, records if reading is None else (*records, ("sensor fault", name))


def take_bools(
    name: str,
    reading: object,
    size: int,
    otherwise: tuple[bool, ...],
    records: tuple[tuple[str, str], ...],
) -> tuple[tuple[bool, ...], bool, tuple[tuple[str, str], ...]]:
    """Take an array of bools; it is faulty if one element is of another type."""
    if reading is None:
        return otherwise, False, records
    if isinstance(reading, list | tuple) and len(reading) == size:
        values = tuple(reading)
        if all(isinstance(value, bool) for value in values):
            return values, True, records
    return otherwise, False, (*records, ("sensor fault", name))


def take_number(
    name: str,
    reading: object,
    factor: float,
    low: float | None,
    high: float | None,
    members: tuple[float, ...] | None,
    otherwise: float,
    records: tuple[tuple[str, str], ...],
) -> tuple[float, bool, tuple[tuple[str, str], ...]]:
    """Take a number times `factor`, clamped to its range; it must be one of `members`, if there are any."""
    if reading is None:
        return otherwise, False, records
    number = as_float(reading)
    if number is None or (members is not None and number not in members):
        return otherwise, False, (*records, ("sensor fault", name))
    value = number * factor
    inside = clamped(value, low, high)
    return inside, True, records if inside == value else (*records, ("sensor clamped", name))


def take_numbers(
    name: str,
    reading: object,
    size: int,
    factor: float,
    low: float | None,
    high: float | None,
    members: tuple[float, ...] | None,
    otherwise: tuple[float, ...],
    records: tuple[tuple[str, str], ...],
) -> tuple[tuple[float, ...], bool, tuple[tuple[str, str], ...]]:
    """Take an array of numbers; it is faulty if one element is not a number, or not a member."""
    if reading is None:
        return otherwise, False, records
    if not isinstance(reading, list | tuple) or len(reading) != size:
        return otherwise, False, (*records, ("sensor fault", name))
    if members is None and set(map(type, reading)) == {float} and (added := sum(reading)) == added:  # quick
        scaled = tuple(reading) if factor == 1.0 else tuple([element * factor for element in reading])
        if (low is None or min(scaled) >= low) and (high is None or max(scaled) <= high):
            return scaled, True, records
    values = []
    for element in reading:
        number = as_float(element)
        if number is None or (members is not None and number not in members):
            return otherwise, False, (*records, ("sensor fault", name))
        values.append(number * factor)
    inside = tuple([clamped(value, low, high) for value in values])
    clean = inside == tuple(values)
    return inside, True, records if clean else (*records, ("sensor clamped", name))


# --- sensors -------------------------------------------------------------------------------------------
#
# Validation of sensors' readings, and stand-ins for missing ones.


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
