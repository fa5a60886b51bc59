"""Numbers and the units right after them: what belongs together, and the exact value."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.dsl.check.compatibility import literal
from colony.ir import expression as e
from colony.ir.program import Let
from colony.text.units import BASE_UNITS
from tests.dsl.texts import expression, findings, named, type_of, value_of


@pytest.mark.parametrize(
    ("text", "value", "type_"),
    [
        ("600 mm", 600.0, "mm"),
        ("600mm", 600.0, "mm"),
        ("2s", 2.0, "s"),
        ("2\ts", 2.0, "s"),
        ("2\r\n s", 2.0, "s"),  # line breaks mean nothing
        ("5 min", 300.0, "s"),
        ("1.5 m/s^2", 1500.0, "mm/s^2"),
        ("0.2 s^-1", 0.2, "s^-1"),
        ("3 m*m", 3e6, "mm^2"),
        ("3 m^2*s/deg", 3e6, "mm^2*s/deg"),
        ("1 m/mm", 1000.0, "number"),
        ("1 inch", 25.4, "mm"),
        ("1 ft", 304.8, "mm"),
        ("12 cm", 120.0, "mm"),
        ("250 ms", 0.25, "s"),
        ("1 rad", 57.29577951308232, "deg"),
        ("3.141592653589793 rad", 180.0, "deg"),
        ("1e3", 1000.0, "number"),
        ("1e3 mm", 1000.0, "mm"),
        ("1e3mm", 1000.0, "mm"),
        ("2E-2 m", 20.0, "mm"),
        ("1e+2", 100.0, "number"),
        ("007", 7.0, "number"),
        ("0.1 m", 100.0, "mm"),  # 0.1 * 1000 rounds to the same, but
        ("0.3 ft", 91.44, "mm"),  # rounded twice this would be 91.44000000000001
        ("1.1 inch", 27.94, "mm"),
        ("0 mm", 0.0, "mm"),
        ("1e-400", 0.0, "number"),
        ("123456789012345678901234567890 mm", 1.2345678901234568e29, "mm"),
    ],
)
def test_a_number_and_its_unit(text: str, value: float, type_: str) -> None:
    assert value_of(text) == value
    assert type_of(text) == type_


@pytest.mark.parametrize(
    ("text", "type_"),
    [
        ("600 mm / s", "mm/s"),  # divides by something called s
        ("2 m/speed", "s"),  # the unit ends where a longer name goes on
        ("2 m*m2", "mm^2"),
        ("6 m/s / s", "mm/s^2"),
    ],
)
def test_what_follows_a_unit(text: str, type_: str) -> None:
    found = expression(text, "let s = 1 s\nlet speed = 1 m/s\nlet m2 = 2 m")
    assert isinstance(found, e.BinaryOperation)
    assert str(found.type) == type_


def test_a_unit_stands_in_the_line_of_its_number() -> None:
    text = "network { a = first suppresses second }\nlet x = 3\nmodule m { when true }"
    assert findings(text + "module first = m module second = m") == []
    assert findings("machine p { start q q -> r when docked_at > 3\n r -> q when true }") == []


def test_elsewhere_units_are_ordinary_names() -> None:
    found = expression("m + s", "let m = 3\nlet s = 4")
    assert isinstance(found, e.BinaryOperation)
    assert found.left == e.DerivedValue(type=found.type, name="m")


@pytest.mark.parametrize(
    "text", ["5.", ".5", "1..2", "1e", "1 e3", "0x10", "1_000", "1 m/", "1 m^", "1 m^-", "5 lb"]
)
def test_no_numbers(text: str) -> None:
    found = findings(f"let x = {text}")
    assert found
    assert found[0].endswith("E005")


@pytest.mark.parametrize("text", ["1e309", "1e999999999", "9" * 10_000, "1" + "0" * 400, "1e308 m", "2e308"])
def test_what_overflows_is_an_error(text: str) -> None:
    assert findings(f"let x = {text}") == ["1:9 E010"]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0e999999999", 0.0),
        ("1e-999999999", 0.0),
        ("0." + "0" * 20_000 + "1", 0.0),
        ("0." + "0" * 20_000 + "1e20001", 1.0),
        ("1" + "0" * 5000 + "e-5000", 1.0),
        ("1.7976931348623157e308", 1.7976931348623157e308),
        ("4.9406564584124654e-324", 5e-324),
        ("2.4703282292062327e-324", 0.0),
        ("1." + "3" * 9000, 4 / 3),
    ],
)
def test_numbers_of_many_digits(text: str, value: float) -> None:
    assert value_of(text) == value


def test_a_tie_is_broken_by_the_last_of_many_digits() -> None:
    tie = Fraction(1) + Fraction(1, 2**53)  # half-way between 1 and the next double
    digits = f"1.{int((tie - 1) * 10**53):053d}"
    zeros = "0" * 3000
    assert literal(digits + zeros, Fraction(1)) == 1.0
    assert literal(digits + zeros + "1", Fraction(1)) == math.nextafter(1.0, 2.0)


_UNITS = st.sampled_from(sorted(BASE_UNITS))


@given(st.from_regex(r"[0-9]{1,25}(\.[0-9]{1,25})?([eE][+-]?[0-9]{1,2})?", fullmatch=True), _UNITS)
def test_literals_are_converted_exactly_and_rounded_once(digits: str, unit: str) -> None:
    factor = BASE_UNITS[unit][1]
    assert literal(digits, factor) == float(Fraction(digits) * factor)


@given(st.floats(allow_nan=False, allow_infinity=False, min_value=0))
def test_every_float_can_be_written(value: float) -> None:
    assert literal(repr(value), Fraction(1)) == value


# --- durations -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "ns"),
    [
        ("1 s", 1_000_000_000),
        ("0.1 s", 100_000_000),
        ("1.5 min", 90_000_000_000),
        ("0.3 ms", 300_000),
        ("1e-9 s", 1),
        ("0.4e-9 s", 0),
        ("0.5e-9 s", 1),  # the double of 0.5e-9 is a little more than a half
        ("33 ms / 2", 16_500_000),
        ("0", 0),
        ("0.1 s + 0.2 s", 300_000_000),
        ("1e9 s", 10**18),
    ],
)
def test_durations_are_whole_nanoseconds(text: str, ns: int) -> None:
    found = named(Let, "x", f"let x = recently(bumper, {text})").expression
    assert isinstance(found, e.MemoryCall)
    assert found.duration_ns == ns


def test_durations_of_centuries_are_refused() -> None:
    assert findings("let x = recently(bumper, 2e9 s)") == ["1:26 E213"]


# --- constants -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 + 2 * 3", 7.0),
        ("(1 + 2) * 3", 9.0),
        ("-3 mm", -3.0),
        ("--3", 3.0),
        ("7 / 2", 3.5),
        ("1 m / 1 mm", 1000.0),
        ("0.1 + 0.2", 0.30000000000000004),
        ("1 - 1 - 1", -1.0),
        ("true", True),
        ("false", False),
        ("q", 2.0),
        ("q * q - 1", 3.0),
        ("g.b", 5.0),
    ],
)
def test_constants(text: str, value: object) -> None:
    found = value_of(text, "param q = 2 enum g { a = 1, b = 5 }")
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize("text", ["1 / 0", "-1 / 0", "0 / 0", "1e200 * 1e200", "1e308 + 1e308"])
def test_constants_are_finite(text: str) -> None:
    assert findings(f"param p = {text}") == ["1:11 E212"]
