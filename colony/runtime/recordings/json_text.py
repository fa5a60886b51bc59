"""Times, numbers and readings as JSON that reads back to the same bits."""

from __future__ import annotations

import json
import re
import sys

from colony.ir.frame import Frame, Reading
from colony.ir.program import Sensor
from colony.ir.types import Array, ScalarValue

_MAX_DOUBLE = sys.float_info.max


def seconds_text(t_ns: int) -> str:
    """Return nanoseconds as a decimal number of seconds, exactly."""
    whole, rest = divmod(abs(t_ns), 1_000_000_000)
    fraction = f"{rest:09d}".rstrip("0") or "0"
    return f"{'-' if t_ns < 0 else ''}{whole}.{fraction}"


def sensor_members(frame: Frame, sensors: tuple[Sensor, ...]) -> list[str]:
    """Return the readings of a frame as JSON members that read back to the same doubles."""
    members = []
    for sensor in sensors:
        reading = frame.readings.get(sensor.name)
        if reading is not None:
            size = sensor.type.size if isinstance(sensor.type, Array) else None
            members.append(f"{json.dumps(sensor.name)}: {_reading(reading, size)}")
        elif sensor.sent is not None and sensor.name in frame.readings:
            members.append(f"{json.dumps(sensor.name)}: null")  # without it, a reader takes its own
    return members


def _reading(reading: Reading, size: int | None) -> str:
    if isinstance(reading, (list, tuple)):
        if size is not None and len(reading) != size:
            return json.dumps(f"{len(reading)} elements")  # a faulty reading, recorded as one
        return "[" + ", ".join(map(number_text, reading)) + "]"
    if isinstance(reading, (bool, int, float)):
        return number_text(reading)
    return json.dumps(str(reading))


_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")


def lone_surrogate(text: str, value: object) -> int | None:
    """Return the offset of an escape in JSON that makes its `value` no text; None if there is none."""
    found = _SURROGATE.search(text)
    if found is not None:
        try:
            json.dumps(value, ensure_ascii=False).encode()
        except UnicodeEncodeError:
            return found.start()
    return None


def parse_int(text: str) -> int | float:
    """Return an integer of JSON; one beyond 64 bits as a double, infinite beyond all doubles.

    Raises:
        ValueError: it has thousands of digits.
    """
    value = int(text)
    return value if -(2**63) <= value < 2**63 else float(text)


def number_text(value: ScalarValue) -> str:
    """Return a number as JSON.

    JSON has neither infinities nor NaN. Infinities, and ints too large for a double, are written as a number
    that overflows a double. NaN is written as a string: a value of the wrong type is a faulty reading, like
    NaN.
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        if abs(value) <= _MAX_DOUBLE:
            return repr(value)
        return '"nan"' if value != value else ("1e999" if value > 0 else "-1e999")
    return json.dumps(value)
