"""Statements that validate a sensor's reading: inline tests for usual readings, a function call for others.

A reading is usual if it is present, of exactly the declared type (a float, not an int), and within range.
"""

from __future__ import annotations

from colony.compile.backends.python.names import Names
from colony.compile.backends.python.text import literal
from colony.execute.sensors import members, stand_in
from colony.ir.program import Sensor
from colony.ir.types import Array, Bool, ScalarValue, Value, element_type


def constants(sensors: tuple[Sensor, ...]) -> list[str]:
    """Return the constants that the inline tests use, as statements of the generated Python module."""
    array_types = set()
    for sensor in sensors:
        if isinstance(sensor.type, Array):
            kind = "bool" if isinstance(sensor.type.element, Bool) else "float"
            array_types.add((kind, sensor.type.size))
    return [f"{_types(kind, size)} = [{kind}] * {size}" for kind, size in sorted(array_types)]


def _types(kind: str, size: int) -> str:
    return f"{kind.upper()}S_{size}"


def validation_statements(sensor: Sensor, names: Names) -> list[str]:
    """Return the statements that set a sensor's value (or stand-in) and its freshness.

    Without a reading of what an actuator was given last, it is what the program itself sent.
    """
    otherwise = f", self.{names.last[sensor.name]}" if sensor.sent is not None else ""
    value, fresh = names.sensors[sensor.name], names.fresh[sensor.name]
    converted = sensor.factor != 1.0 and not isinstance(element_type(sensor.type), Bool)
    reading = "reading" if converted else value
    inline_tests = _array_tests if isinstance(sensor.type, Array) else _scalar_tests
    return [
        f"{reading} = readings.get({sensor.name!r}{otherwise})",
        *_if(inline_tests(sensor, reading, value)),
        f"    {fresh} = True",
        "else:",
        f"    {value}, {fresh}, records = {_validation_call(sensor, reading)}",
    ]


def _if(tests: list[str]) -> list[str]:
    """Return an `if` for all tests, on one line if it is short."""
    line = f"if {' and '.join(tests)}:"
    if len(line) <= 96:
        return [line]
    return ["if (", f"    {tests[0]}", *[f"    and {test}" for test in tests[1:]], "):"]


def _scalar_tests(sensor: Sensor, reading: str, value: str) -> list[str]:
    """Return the inline tests of a scalar; they also convert it where necessary."""
    if isinstance(sensor.type, Bool):
        return [f"{reading} is True or {reading} is False"]
    tests, numbers = [f"type({reading}) is float"], members(sensor)
    if reading != value:
        tests.append(f"({value} := {reading} * {literal(sensor.factor).text}) == {value}")
    if numbers is not None:
        return [*tests, f"{value} in {_listed(numbers)}"]
    if sensor.low is not None and sensor.high is not None:
        return [*tests, f"{literal(sensor.low).text} <= {value} <= {literal(sensor.high).text}"]
    range_test = _in_range(sensor, value)
    return (
        [*tests, range_test] if range_test else [*tests, f"{value} == {value}"] if len(tests) == 1 else tests
    )


def _array_tests(sensor: Sensor, reading: str, value: str) -> list[str]:
    """Return the inline tests of an array; they also convert it where necessary."""
    assert isinstance(sensor.type, Array)
    kind, numbers = sensor.type.element, members(sensor)
    name = "bool" if isinstance(kind, Bool) else "float"
    tests = [
        f"(type({reading}) is list or type({reading}) is tuple)",
        f"[*map(type, {reading})] == {_types(name, sensor.type.size)}",
    ]
    if isinstance(kind, Bool):
        return tests
    if reading != value:
        tests.append(f"({value} := [x * {literal(sensor.factor).text} for x in {reading}])")
    if numbers is not None:
        return [*tests, f"not [x for x in {value} if x not in {_listed(numbers)}]"]
    range_test = _in_range(sensor, "x")
    return [
        *tests,
        f"not [x for x in {value} if not ({range_test})]" if range_test else f"sum({value}) <= inf",
    ]


def _in_range(sensor: Sensor, x: str) -> str:
    """Return a test of the range, which NaN fails; an empty string if there is no range."""
    tests = [f"{literal(sensor.low).text} <= {x}"] if sensor.low is not None else []
    tests += [f"{x} <= {literal(sensor.high).text}"] if sensor.high is not None else []
    return " and ".join(tests)


def _validation_call(sensor: Sensor, reading: str) -> str:
    """Return a call of the function that validates any reading."""
    kind, array = element_type(sensor.type), isinstance(sensor.type, Array)
    arguments = [repr(sensor.name), reading]
    if isinstance(sensor.type, Array):
        arguments.append(str(sensor.type.size))
    if not isinstance(kind, Bool):
        numbers = members(sensor)
        arguments += [literal(sensor.factor).text, _optional(sensor.low), _optional(sensor.high)]
        arguments.append("None" if numbers is None else _listed(numbers))
    function = "take_bool" if isinstance(kind, Bool) else "take_number"
    return f"{function}{'s' if array else ''}({', '.join(arguments)}, {values(stand_in(sensor))}, records)"


def values(value: Value) -> str:
    """Return a value as a constant; an array of equal elements as `(x,) * n`."""
    if not isinstance(value, tuple):
        return literal(value).text
    if len(value) > 4 and all(_same(x, value[0]) for x in value):
        return f"({literal(value[0]).text},) * {len(value)}"
    return _listed(value)


def _same(x: ScalarValue, y: ScalarValue) -> bool:
    return repr(x) == repr(y)


def _listed(elements: tuple[ScalarValue, ...]) -> str:
    return f"({', '.join(literal(x).text for x in elements)}{',' if len(elements) == 1 else ''})"


def _optional(bound: float | None) -> str:
    return "None" if bound is None else literal(bound).text
