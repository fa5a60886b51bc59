"""Scenarios: what a program reads that nobody simulates, over time.

    # the emergency stop is pressed for three seconds
    at 0 s   load = 12 kg, pose_x = 2 m
    at 12 s  estop = true
    at 15 s  estop = false, pose_x = missing

A name is that of a sensor of the program. A value holds until the next one; `missing` is none. Variables of
DServer are set by a script, as an operator would set them; the simulated devices read all others from the
scenario in place of what they measure. Times count from the beginning of the run.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import NamedTuple

from colony.execute.intake import converted
from colony.files import read_file, reason
from colony.ir.fitting import name_hint
from colony.ir.program import TUNABLE_SERVER, Robot, Sensor
from colony.ir.servers import DSERVER, PROXIMITY, RSERVER, RUNTIME, FieldSpec
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
from colony.runtime.kit.script import Script, do, sleep
from colony.runtime.library import data
from colony.runtime.library.clock import tune
from colony.runtime.protocol.calls import RefusedError
from colony.runtime.protocol.deployment import tunables_of, tuned_with
from colony.runtime.protocol.topics import CLOCK
from colony.sim.mechanism import GivenTimeline, GivenValue
from colony.text.units import (
    BASE_UNITS,
    NUMBER,
    TIME,
    Dimension,
    UnitError,
    common_units,
    nanoseconds,
    parse_unit,
)
from colony.text.wording import counted, did_you_mean, listed, shortened

# --- values ------------------------------------------------------------------------------------------


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


# --- scenarios ---------------------------------------------------------------------------------------


MAX_BYTES = 1 << 20
"""Maximum size of the file of a scenario."""

SET_INTERVAL_S = 0.1
"""Seconds between two times that a variable is set, so that it stays fresh."""

_PLAYED = (DSERVER.name, TUNABLE_SERVER)
"""The servers that a script gives values, instead of a device."""

_LINE = re.compile(r"at\s+(\S+(?:\s*[A-Za-z]+)?)\s+([A-Za-z_].*)")
_COMMA = re.compile(r",(?![^\[]*\])")
_SIMULATED = {
    RSERVER.name: "the simulated base measures it",
    PROXIMITY: "the simulated sonars and infrared detectors measure it",
    RUNTIME.name: "it is drawn from the run's seed",
}


class ScenarioError(ValueError):
    """A scenario cannot be read; the message is one line that begins with the file."""


class ReadingChange(NamedTuple):
    """What a sensor reads from a time on, in its declared unit; None for nothing."""

    t_ns: int
    sensor: Sensor
    value: Value | None

    @property
    def given(self) -> GivenValue:
        """What a device reads, in base units."""
        factor = self.sensor.factor
        value = converted(self.value, lambda x: x * factor)
        return "missing" if value is None else value  # type: ignore[return-value]


class Scenario:
    """What sensors read over time, from changes in any order; the last one of a time counts."""

    def __init__(self, changes: Iterable[ReadingChange] = ()) -> None:
        self.changes = tuple(sorted(changes, key=lambda change: change.t_ns))
        self._timeline = GivenTimeline()
        for change in self.changes:
            self._timeline.add(change.sensor.server, change.sensor.field, change.t_ns, change.given)

    def __bool__(self) -> bool:
        """Return True if it says anything."""
        return bool(self.changes)

    def value_at(self, server: str, field: str, t_ns: int) -> GivenValue:
        """Return what a field reads at a time, in base units; None if the scenario says nothing of it yet."""
        return self._timeline.value_at(server, field, t_ns)

    @property
    def variables(self) -> tuple[ReadingChange, ...]:
        """The changes of DServer's variables and of tunable params."""
        return tuple(change for change in self.changes if change.sensor.server in _PLAYED)

    @property
    def fields(self) -> tuple[ReadingChange, ...]:
        """The changes of what devices read."""
        return tuple(change for change in self.changes if change.sensor.server not in _PLAYED)


def setting(robot: Robot, text: str) -> ReadingChange:
    """Return what the text `NAME=VALUE` of `--set` says, from the start on.

    Raises:
        GivenValueError: the text is not of this form, or the program reads no such value.
    """
    return _change(robot, 0, text)


def read_scenario(path: str, robot: Robot) -> Scenario:
    """Return the scenario in a file, for the sensors of a program.

    Raises:
        ScenarioError: the file cannot be read, or a line is not of the form or gives a second
            value at one time.
    """
    try:
        text = read_file(path, MAX_BYTES).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as problem:
        why = reason(problem) if isinstance(problem, OSError) else "it is not UTF-8"
        raise ScenarioError(f"{path}: error: cannot read the scenario: {why}") from None
    changes: list[ReadingChange] = []
    given: dict[tuple[int, str, str], int] = {}  # the line of the value at a time of a field
    for number, line in enumerate(text.splitlines(), 1):
        try:
            for change in _changes(line.partition("#")[0].strip(), robot):
                key = change.t_ns, change.sensor.server, change.sensor.field
                if key in given:
                    message = f"`{change.sensor.name}` has a value at this time already, in line {given[key]}"
                    raise GivenValueError(message)
                given[key] = number
                changes.append(change)
        except GivenValueError as problem:
            raise ScenarioError(f"{path}:{number}: error: {problem}") from None
    return Scenario(changes)


def expect_givable(name: str, server: str) -> None:
    """Check that what the server of a sensor reads may be given.

    Raises:
        GivenValueError: it may not; the message has the name.
    """
    if server in _SIMULATED:
        raise GivenValueError(f"`{name}` cannot be given: {_SIMULATED[server]}")


def _changes(line: str, robot: Robot) -> Iterator[ReadingChange]:
    if not line:
        return
    parts = _LINE.fullmatch(line)
    seconds = None if parts is None else parse_number(parts[1], TIME, 1.0)
    if parts is None or seconds is None or not 0.0 <= seconds <= 1e9:
        expected = "expected `at TIME NAME = VALUE`, such as `at 12 s estop = true`"
        raise GivenValueError(f"found `{shortened(line)}`; {expected}")
    for text in _COMMA.split(parts[2]):
        yield _change(robot, nanoseconds(seconds), text)


def _change(robot: Robot, t_ns: int, text: str) -> ReadingChange:
    text = text.strip()
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (name and equals):
        raise GivenValueError(f"found `{shortened(text)}`; expected NAME=VALUE")
    sensor = sensor_named(robot, name)
    expect_givable(name, sensor.server)
    try:
        change = ReadingChange(t_ns, sensor, None if value == "missing" else parse_value(sensor, value))
        if sensor.tunable and isinstance(change.value, int | float):
            tuned_with(tunables_of(robot), {}, {sensor.name: change.value})
        return change
    except RefusedError as problem:
        raise GivenValueError(problem.problem.message) from None
    except GivenValueError as problem:
        raise GivenValueError(f"{name}: {problem}") from None


def player(
    changes: tuple[ReadingChange, ...],
    begin_ns: Callable[[], int | None] = lambda: 0,
    held: Mapping[str, Value] | None = None,
) -> Script:
    """Return a script that sets variables of DServer as a scenario says, again and again until it changes.

    Tunable params are changed once; `missing` sets one back to the value at the start of the run.

    Args:
        changes: the changes, in chronological order.
        begin_ns: function that returns the robot's time at which the run began; None until it has begun,
            which counts as time 0.
        held: other variables, with the values at which they are held.
    """
    now = dict(held or {})
    i = 0
    while True:
        now_ns, begun_ns = (yield from sleep(0.0)), begin_ns()
        t_ns = 0 if begun_ns is None else now_ns - begun_ns
        tuned: dict[str, float | None] = {}
        while i < len(changes) and changes[i].t_ns <= t_ns:
            _, sensor, value = changes[i]
            if sensor.tunable and begun_ns is None:
                break  # there is no program yet
            i += 1
            if sensor.tunable:
                tuned[sensor.name] = None if value is None else float(value)  # type: ignore[arg-type]
            elif value is not None:
                now[sensor.field] = value
            elif now.pop(sensor.field, None) is not None:
                yield from do(DSERVER.name, data.delete(sensor.field))
        if tuned:
            yield from do(CLOCK, tune(tuned))
        if now:
            yield from do(DSERVER.name, data.set_many(now))
        due_s = (changes[i].t_ns - t_ns) / 1e9 if i < len(changes) else SET_INTERVAL_S
        yield from sleep(min(max(due_s, 0.0), SET_INTERVAL_S))
