"""Statements that validate a sensor's reading: inline tests for usual readings, a function for the others.

A reading is usual if it is present, of exactly the declared type (a float, not an int), and within the range.
"""

from __future__ import annotations

from colony.compile.backends.python.names import Names
from colony.compile.backends.python.text import literal
from colony.execute.sensors import members, stand_in
from colony.ir.program import Sensor
from colony.ir.types import Array, Bool, ScalarValue, Value, element_type


def constants(sensors: tuple[Sensor, ...]) -> list[str]:
    """Return the constants that the quick tests compare with, as statements of the module."""
    found = set()
    for sensor in sensors:
        if isinstance(sensor.type, Array):
            kind = "bool" if isinstance(sensor.type.element, Bool) else "float"
            found.add((kind, sensor.type.size))
    return [f"{_types(kind, size)} = [{kind}] * {size}" for kind, size in sorted(found)]


def _types(kind: str, size: int) -> str:
    return f"{kind.upper()}S_{size}"


def take(sensor: Sensor, get: str, names: Names) -> list[str]:
    """Return the statements for one sensor: its value (or stand-in), and its freshness."""
    value, fresh = names.sensors[sensor.name], names.fresh[sensor.name]
    converted = sensor.factor != 1.0 and not isinstance(element_type(sensor.type), Bool)
    reading = "reading" if converted else value
    usual = _fast_array_tests if isinstance(sensor.type, Array) else _fast_tests
    return [
        f"{reading} = {get}({sensor.name!r})",
        *_if(usual(sensor, reading, value)),
        f"    {fresh} = True",
        "else:",
        f"    {value}, {fresh}, records = {_slow_call(sensor, reading)}",
    ]


def _if(tests: list[str]) -> list[str]:
    """Return the condition that all tests hold, on one line if it is short."""
    line = f"if {' and '.join(tests)}:"
    if len(line) <= 96:
        return [line]
    return ["if (", f"    {tests[0]}", *[f"    and {test}" for test in tests[1:]], "):"]


def _fast_tests(sensor: Sensor, reading: str, value: str) -> list[str]:
    """Return the quick tests of a scalar; they also convert it where necessary."""
    if isinstance(sensor.type, Bool):
        return [f"{reading} is True or {reading} is False"]
    tests, numbers = [f"type({reading}) is float"], members(sensor)
    if reading != value:
        tests.append(f"({value} := {reading} * {literal(sensor.factor).text}) == {value}")
    if numbers is not None:
        return [*tests, f"{value} in {_listed(numbers)}"]
    if sensor.low is not None and sensor.high is not None:
        return [*tests, f"{literal(sensor.low).text} <= {value} <= {literal(sensor.high).text}"]
    ranged = _in_range(sensor, value)
    return [*tests, ranged] if ranged else [*tests, f"{value} == {value}"] if len(tests) == 1 else tests


def _fast_array_tests(sensor: Sensor, reading: str, value: str) -> list[str]:
    """Return the quick tests of an array."""
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
    ranged = _in_range(sensor, "x")
    return [*tests, f"not [x for x in {value} if not ({ranged})]" if ranged else f"sum({value}) <= inf"]


def _in_range(sensor: Sensor, x: str) -> str:
    """Return a test of the range, which NaN fails; empty where there is no range."""
    tests = [f"{literal(sensor.low).text} <= {x}"] if sensor.low is not None else []
    tests += [f"{x} <= {literal(sensor.high).text}"] if sensor.high is not None else []
    return " and ".join(tests)


def _slow_call(sensor: Sensor, reading: str) -> str:
    """Return the call that validates any reading."""
    kind, array = element_type(sensor.type), isinstance(sensor.type, Array)
    parts = [repr(sensor.name), reading]
    if isinstance(sensor.type, Array):
        parts.append(str(sensor.type.size))
    if not isinstance(kind, Bool):
        numbers = members(sensor)
        parts += [literal(sensor.factor).text, _optional(sensor.low), _optional(sensor.high)]
        parts.append("None" if numbers is None else _listed(numbers))
    function = "take_bool" if isinstance(kind, Bool) else "take_number"
    return f"{function}{'s' if array else ''}({', '.join(parts)}, {values(stand_in(sensor))}, records)"


def values(value: Value) -> str:
    """Return a value as a constant; an array of equal elements as a product."""
    if not isinstance(value, tuple):
        return literal(value).text
    if len(value) > 4 and all(_same(x, value[0]) for x in value):
        return f"({literal(value[0]).text},) * {len(value)}"
    return _listed(value)


def _same(x: ScalarValue, y: ScalarValue) -> bool:
    return repr(x) == repr(y)


def _listed(several: tuple[ScalarValue, ...]) -> str:
    return f"({', '.join(literal(x).text for x in several)}{',' if len(several) == 1 else ''})"


def _optional(bound: float | None) -> str:
    return "None" if bound is None else literal(bound).text
