"""Validation of readings for an executor: checks, conversion, clamping, records.

Like those of `arithmetic`, these functions use only `math`, as the Python backend copies them into generated
programs. Each `take_` function returns the value (`otherwise` if the reading is missing or faulty), True if
the sensor is fresh, and the records, to which it may add one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf, nan

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
        if set(map(type, reading)) == {float}:  # quick; NaN stays what it is
            return tuple(map(convert, reading))
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
