"""Numbers are written short, in the declared unit, and mean exactly what they stand for."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colony.dsl.load import load_text
from colony.ir.program import Program, Sensor
from colony.verify.contracts.table import NumberText, number_text, rounded, seconds, value_of


def robot(unit: str) -> str:
    return f"""robot r {{
  sensor s : {unit} from PServer.s
  actuator a {{ on : bool }} to DServer.A idle hold
}}
let l = s
"""


def sensor(unit: str) -> Sensor:
    return load_text(robot(unit)).robot.sensors[0]


@pytest.mark.parametrize(
    ("unit", "value", "written"),
    [
        ("mm", 300.0, "300 mm"),
        ("m", 300.0, "0.3 m"),
        ("m", -1500.0, "-1.5 m"),
        ("number", 0.1, "0.1"),
        ("number", 1e300, "1e300"),
        ("number", 2.5e-9, "2.5e-9"),
        ("deg", 45.0, "45 deg"),
        ("mm/s", 0.0, "0 mm/s"),
        ("min", 90.0, "1.5 min"),
        ("m/s^2", 9810.0, "9.81 m/s^2"),
        ("inch", 25.4, "1 inch"),
    ],
)
def test_short_numbers_in_the_declared_unit(unit: str, value: float, written: str) -> None:
    assert str(number_text(value, sensor(unit))) == written


def test_what_the_declared_unit_cannot_say_is_said_in_base_units() -> None:
    value = 57.29577951308233  # the nearest float to 1 rad is another one
    assert value_of(number_text(value, sensor("rad"))) == value


def test_an_infinite_value_cannot_be_written() -> None:
    assert number_text(float("inf"), sensor("mm")) is None


@pytest.mark.parametrize("unit", ["number", "inch", "rad"])
@given(value=st.floats(allow_nan=False, allow_infinity=False))
@settings(max_examples=40, deadline=None)
def test_every_number_means_what_it_stands_for_in_the_language(unit: str, value: float) -> None:
    written = number_text(value, sensor(unit))
    assert value_of(written) == value
    assert given_value(unit, written) == value


def given_value(unit: str, written: NumberText) -> float:
    """What a test of the language gives a sensor by a number as written."""
    made: Program = load_text(f'{robot(unit)}test "t" {{ at 0 s given s = {written} }}\n')
    [value] = [g.value for step in made.tests[0].steps for g in step.given]
    return value


def test_rounding_is_in_the_declared_unit() -> None:
    assert rounded(1234.5678, sensor("m"), 2) == 1200.0
    assert rounded(1234.5678, sensor("m"), 5) == 1234.6


@pytest.mark.parametrize(
    ("t_ns", "written"), [(0, "0 s"), (50_000_000, "0.05 s"), (1, "1e-9 s"), (3_600_000_000_000, "3600 s")]
)
def test_times_are_exact(t_ns: int, written: str) -> None:
    assert str(seconds(t_ns)) == written
