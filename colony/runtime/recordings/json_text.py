"""Times, numbers and readings as JSON that reads back to the same bits."""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Mapping
from typing import Literal

import msgspec

from colony.ir.frame import Answer, Frame, Reading
from colony.ir.memory import ProgramMemory
from colony.ir.program import Program, Sensor
from colony.ir.types import Array, Bool, ScalarValue
from colony.runtime.frames.run_frame import Keyframe

# --- answers -------------------------------------------------------------------------------------------
#
# The recorded answers of modules in Python, so that readers of a recording need not run the modules.
#
# {"seeks": {"command": [300.0, -2.5]}, "rests": {}, "fails": {"error": true, "blind": true}}
#
# `command` has the fields in their declared order, in base units (mm, s, deg), as the module answered; it
# is absent if the module was not applicable, or had no answer (`blind`). A module whose answer is unknown
# is absent.


class AnswerMessage(msgspec.Struct, frozen=True, kw_only=True):
    """An answer in its recorded form; strings stand for values that JSON numbers cannot represent."""

    command: tuple[float | bool | Literal["nan", "inf", "-inf"], ...] | None = None
    error: bool = False
    blind: bool = False


def answers_text(answers: Mapping[str, Answer]) -> str:
    """Return the JSON object of the answers of a frame."""
    return json.dumps({module: _members(answer) for module, answer in answers.items()})


def _members(answer: Answer) -> dict[str, object]:
    members: dict[str, object] = {} if answer.values is None else {"command": [*map(_value, answer.values)]}
    flags = {"error": answer.error, "blind": answer.blind}
    return {**members, **{name: True for name, is_set in flags.items() if is_set}}


def _value(x: float | bool) -> float | bool | str:
    return x if math.isfinite(x) else repr(x)


def read_answers(recorded: Mapping[str, AnswerMessage], program: Program) -> dict[str, Answer]:
    """Return the recorded answers of a frame.

    Raises:
        ValueError: a module of the program does not command these fields.
    """
    answers = {
        module: Answer(_values(message), message.error, message.blind) for module, message in recorded.items()
    }
    fields = {actuator.name: actuator.fields for actuator in program.robot.actuators}
    for module in program.modules if answers else ():
        values = answers[module.name].values if module.name in answers else None
        expected = [isinstance(f.type, Bool) for f in fields.get(module.actuator or "", ())]
        if values is not None and [isinstance(x, bool) for x in values] != expected:
            raise ValueError(f"the answer of `{module.name}` does not have the fields of its actuator")
    return answers


def _values(recorded: AnswerMessage) -> tuple[float | bool, ...] | None:
    if recorded.command is None:
        return None
    return tuple([float(x) if isinstance(x, str) else x for x in recorded.command])


# --- json text -----------------------------------------------------------------------------------------


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
        if set(map(type, reading)) == {float} and math.isfinite(sum(reading)):  # quick
            return repr(list(reading))
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


# --- keyframes -----------------------------------------------------------------------------------------
#
# Keyframes: snapshots of memory at least twice a second, from which a reader resumes after damage.
#
# {"memory": {"first_ns": 0, "cells": {"state bumps": 3.0, "window drive.0 until": 1750000000}}}
#
# `memory` is the memory before the keyframe's frame, absent if unknown; `first_ns` is absent if memory is
# initial. `last`, absent if empty, has what actuators were given last, for programs that read it.
# `degraded` is true if a client has been lost since the epoch began. Numbers are written as in readings.


class _Memory(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    first_ns: int | None = None
    cells: dict[str, float | bool | int | Literal["nan"]]
    last: dict[str, float | bool] = {}


class _Keyframe(msgspec.Struct, frozen=True):
    memory: _Memory | None = None
    degraded: bool = False


def keyframe_members(keyframe: Keyframe) -> list[str]:
    """Return the members of a JSON object that holds the keyframe."""
    members = []
    if keyframe.memory is not None:
        first, cells = keyframe.memory.first_ns, keyframe.memory.cells
        texts = ", ".join([f"{json.dumps(name)}: {number_text(value)}" for name, value in cells.items()])
        first_member = "" if first is None else f'"first_ns": {first}, '
        sent = ", ".join([f"{json.dumps(n)}: {number_text(x)}" for n, x in keyframe.memory.last.items()])
        last_member = f', "last": {{{sent}}}' if sent else ""
        members.append(f'"memory": {{{first_member}"cells": {{{texts}}}{last_member}}}')
    if keyframe.degraded:
        members.append('"degraded": true')
    return members


def read_keyframe(value: object) -> Keyframe | None:
    """Return the keyframe in a JSON value, None for None; a malformed keyframe has unknown memory."""
    if value is None:
        return None
    try:
        keyframe = msgspec.convert(value, _Keyframe)
    except Exception:  # malformed in any way
        return Keyframe(None)
    memory = keyframe.memory
    if memory is None:
        return Keyframe(None, keyframe.degraded)
    cells = {name: float(x) if isinstance(x, str) else x for name, x in memory.cells.items()}
    return Keyframe(ProgramMemory(first_ns=memory.first_ns, cells=cells, last=memory.last), keyframe.degraded)
