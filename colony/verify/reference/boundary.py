"""The boundary of a program: readings of sensors, and modules written in Python."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from typing import Any

from colony.ir.frame import Answer, Frame, FrameEvent, Reading, RecordKind
from colony.ir.program import Actuator, PythonModule, Sensor
from colony.ir.types import Array, Bool, Enum, Quantity, Scalar, ScalarValue, Value
from colony.text.diagnostics import DiagnosticError, error


class InvalidValueError(Exception):
    """A reading or a field of a Python module's command is not of its type."""


# --- sensors -------------------------------------------------------------------------------------


FUTURE = math.nan
"""The stand-in for a reading taken after its frame: a fault for a sensor of any type."""


def age_checked(sensor: Sensor, reading: Reading, frame: Frame) -> Reading:
    """Return `reading`; None if it is too old, `FUTURE` if it was taken after its frame."""
    taken_ns = frame.taken_ns.get(sensor.name, frame.t_ns)
    if taken_ns > frame.t_ns and sensor.name in frame.readings:
        return FUTURE
    if sensor.within_ns is not None and frame.t_ns - taken_ns > sensor.within_ns:
        return None
    return reading


def sense(sensor: Sensor, reading: Reading, factor: float) -> tuple[Value | None, RecordKind | None]:
    """Return the value of `sensor` in base units, None if it is missing, and the kind of record, if any.

    `factor` is base units per unit of `reading`. One faulty element makes the whole array faulty.
    """
    if reading is None:
        return None, None
    try:
        value = typed(sensor, reading, factor)
    except InvalidValueError:
        return None, "sensor fault"
    in_range = clamped(value, sensor)
    return in_range, None if in_range == value else "sensor clamped"


def typed(sensor: Sensor, reading: Reading, factor: float) -> Value:
    """Return `reading` times `factor`.

    Raises:
        InvalidValueError: it does not have the sensor's type and length.
    """
    if not isinstance(sensor.type, Array):
        return typed_scalar(sensor.type, reading, factor)
    if not isinstance(reading, list | tuple) or len(reading) != sensor.type.size:
        raise InvalidValueError
    if isinstance(sensor.type.element, Quantity) and all(type(x) is float and x == x for x in reading):
        return tuple(x * factor for x in reading)  # hundreds of beams, in a tenth of the time
    return tuple(typed_scalar(sensor.type.element, x, factor) for x in reading)


def typed_scalar(type_: Scalar, reading: object, factor: float = 1.0) -> ScalarValue:
    """Return a bool, a number times `factor`, or an enumerator.

    Raises:
        InvalidValueError: it is not a value of the type, or it is NaN.
    """
    if isinstance(type_, Bool):
        if not isinstance(reading, bool):
            raise InvalidValueError
        return reading
    value = number(reading)
    if math.isnan(value) or (isinstance(type_, Enum) and value not in [n for _, n in type_.members]):
        raise InvalidValueError
    return value * factor


def number(x: object) -> float:
    """Return an int or float as a float; an int too large for a float becomes infinite.

    Raises:
        InvalidValueError: it is neither.
    """
    if isinstance(x, bool) or not isinstance(x, int | float):
        raise InvalidValueError
    try:
        return float(x)
    except OverflowError:
        return math.inf if x > 0 else -math.inf


def clamped(value: Value, sensor: Sensor) -> Value:
    """Return `value` within the sensor's range, element by element."""
    if isinstance(value, tuple):
        low, high = min(value), max(value)  # no reading is NaN
        if clamp(low, sensor.low, sensor.high) == low and clamp(high, sensor.low, sensor.high) == high:
            return value
        return tuple(clamp(x, sensor.low, sensor.high) for x in value)
    return clamp(value, sensor.low, sensor.high)


def clamp(x: ScalarValue, low: float | None, high: float | None) -> ScalarValue:
    """Return `x`, or the bound that it exceeds."""
    if low is not None and x < low:
        return low
    if high is not None and x > high:
        return high
    return x


def default_of(sensor: Sensor) -> Value | None:
    """Return the default of a sensor, None if it has none; a scalar default fills an array."""
    if (
        isinstance(sensor.type, Array)
        and sensor.default is not None
        and not isinstance(sensor.default, tuple)
    ):
        return (sensor.default,) * sensor.type.size
    return sensor.default


# --- commands ------------------------------------------------------------------------------------


def declared_command(actuator: Actuator, command: Sequence[ScalarValue]) -> tuple[ScalarValue, ...]:
    """Return a command in declared units; a bool has no unit."""
    return tuple(
        x if isinstance(x, bool) else x / f.factor for x, f in zip(command, actuator.fields, strict=True)
    )


def fault_of(
    actuator: Actuator,
    winner: str,
    command: Sequence[ScalarValue],
    bounds: Sequence[tuple[float, float] | None],
) -> FrameEvent | None:
    """Return why a command cannot be sent, whatever its fields are clamped to; None if it can."""
    if not all(math.isfinite(x) for x in command):
        return FrameEvent("not finite", winner)
    names = [f"{actuator.name}.{field.name}" for field in actuator.fields]
    for name, b in zip(names, bounds, strict=True):
        if b is None:
            return FrameEvent("bound missing", name)
    for name, b in zip(names, bounds, strict=True):
        if b is not None and b[0] > b[1]:
            return FrameEvent("limits contradict", name)
    return None


# --- modules written in Python -------------------------------------------------------------------


class ModuleFrame(Mapping[str, Value]):
    """The argument of `step`: the values that the module reads, in base units.

    `t` is the time since the first frame in seconds.
    """

    def __init__(self, t: float, values: dict[str, Value]) -> None:
        self.t = t
        self._values = values

    def __getitem__(self, name: str) -> Value:
        """Return the value of a name."""
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        """Return an iterator over the names."""
        return iter(self._values)

    def __len__(self) -> int:
        """Return the number of names."""
        return len(self._values)


Command = tuple[ScalarValue, ...] | None
"""The fields of a command in base units, or None: not applicable."""


class PythonRunner:
    """Runs one Python module. Stateful: the module's object has state."""

    def __init__(self, module: PythonModule, actuator: Actuator | None) -> None:
        """Import and build the class, once.

        Raises:
            DiagnosticError: it cannot be imported or built.
        """
        self.module = module
        self._fields = actuator.fields if actuator else ()
        try:
            cls = getattr(import_module(module.module_path), module.class_name)
            self._object = cls(**dict(module.params))
        except (Exception, SystemExit) as problem:
            path = f"{module.module_path}:{module.class_name}"
            message = f"`{path}` cannot be imported and built: {type(problem).__name__}: {problem}"
            hint = (
                "the class must be importable from the folder of the behavior or the current folder, "
                "and take its params as keyword arguments"
            )
            raise DiagnosticError([error("P001", module.span, message, hint)]) from problem
        self._last_call: int | None = None
        self._answers: list[tuple[int, Answer]] = []  # each with the time from which it applies

    def miss(self) -> None:
        """Forget all answers: something that the module reads is missing."""
        self._answers.clear()

    def step(self, t_ns: int, frame: ModuleFrame) -> Answer:
        """Return the module's answer in a frame; its `error` is of a call in this frame.

        Call it only in frames in which nothing that the module reads is missing.
        """
        if self.module.rate_ns is None:
            return self._call(frame)
        failed = False
        if self._last_call is None or t_ns >= self._last_call + self.module.rate_ns:
            answer = self._call(frame)
            failed = answer.error
            self._answers.append((t_ns + self.module.rate_ns, answer))
            self._last_call = t_ns
        while len(self._answers) > 1 and self._answers[1][0] <= t_ns:
            del self._answers[0]
        stands = bool(self._answers) and self._answers[0][0] <= t_ns
        return (self._answers[0][1] if stands else Answer(blind=True))._replace(error=failed)

    def _call(self, frame: ModuleFrame) -> Answer:
        try:
            return Answer(self._command(self._object.step(frame)))
        except Exception:
            return Answer(error=True, blind=True)

    def _command(self, result: Any) -> Command:
        if result is None:
            return None
        if not hasattr(result, "keys"):
            raise InvalidValueError
        given = {f.name: f.default for f in self._fields if f.default is not None} | {
            name: result[name] for name in result
        }
        if set(given) != {f.name for f in self._fields}:
            raise InvalidValueError
        return tuple(self._field(f.type, given[f.name]) for f in self._fields)

    def _field(self, type_: Scalar, x: object) -> ScalarValue:
        """Return a field, checked. NaN passes: a command that is not finite is a fault of its own."""
        if not isinstance(type_, Bool | Enum) and isinstance(x, float) and math.isnan(x):
            return x
        return typed_scalar(type_, x)
