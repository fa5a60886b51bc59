"""Units and dimensions, and times as whole nanoseconds."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.text.units import (
    ANGLE,
    BASE_UNITS,
    CURRENT,
    LENGTH,
    NUMBER,
    TEMPERATURE,
    TIME,
    VOLTAGE,
    Dimension,
    UnitError,
    nanoseconds,
    parse_unit,
    readable_unit,
)


@pytest.mark.parametrize(
    ("text", "dimension", "factor"),
    [
        ("mm", LENGTH, 1),
        ("cm", LENGTH, 10),
        ("m", LENGTH, 1000),
        ("inch", LENGTH, Fraction(254, 10)),
        ("ft", LENGTH, Fraction(3048, 10)),
        ("ms", TIME, Fraction(1, 1000)),
        ("s", TIME, 1),
        ("min", TIME, 60),
        ("deg", ANGLE, 1),
        ("m/s", Dimension(1, -1), 1000),
        ("m/s^2", Dimension(1, -2), 1000),
        ("m/s/s", Dimension(1, -2), 1000),
        ("s^-1", Dimension(0, -1), 1),
        ("ms^-1", Dimension(0, -1), 1000),
        ("m*s/deg", Dimension(1, 1, -1), 1000),
        ("m/mm", NUMBER, 1000),
        ("m^0", NUMBER, 1),
        ("cm^3", Dimension(3), 1000),
        ("mm/min", Dimension(1, -1), Fraction(1, 60)),
        ("A", CURRENT, 1),
        ("mA", CURRENT, Fraction(1, 1000)),
        ("V", VOLTAGE, 1),
        ("mV", VOLTAGE, Fraction(1, 1000)),
        ("degC", TEMPERATURE, 1),
        ("degC/min", Dimension(0, -1, temperature=1), Fraction(1, 60)),
        ("Hz", TIME.power(-1), 1),
        ("percent", NUMBER, Fraction(1, 100)),
        ("percent/s", TIME.power(-1), Fraction(1, 100)),
    ],
)
def test_units(text: str, dimension: Dimension, factor: Fraction) -> None:
    unit = parse_unit(text)
    assert (unit.text, unit.dimension, unit.factor) == (text, dimension, factor)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("W", "V*A"),
        ("mV*A", "V*mA"),
        ("N", "W*s/m"),
        ("kg", "N*s^2/m"),
        ("Wh", "V*Ah"),
        ("Ah", "A*min"),
        ("Hz", "s^-1"),
        ("m/m", "percent"),
    ],
)
def test_what_follows_of_other_units(one: str, other: str) -> None:
    a, b = parse_unit(one), parse_unit(other)
    assert a.dimension == b.dimension
    assert a.factor == b.factor * {"Ah": 60, "m/m": 100}.get(one, 1)


def test_a_gram_is_a_thousandth_of_a_kilogram() -> None:
    assert parse_unit("g") == ("g", parse_unit("kg").dimension, parse_unit("kg").factor / 1000)
    assert str(parse_unit("kg").dimension) == "s^3*A*V/mm^2"


def test_a_radian_is_exact_enough_for_any_float() -> None:
    assert float(parse_unit("rad").factor) == math.degrees(1)
    assert abs(parse_unit("rad").factor * Fraction(math.pi) - 180) < Fraction(1, 10**13)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "lb",
        "Ma",
        "degc",
        "m/",
        "/s",
        "m s",
        "m*",
        "*m",
        "m^",
        "m^x",
        "m^1.5",
        "m//s",
        "1/s",
        "m^10",
        "m^-10",
        "m^999999999999",
        "M",
        "mm2",
    ],
)
def test_what_is_no_unit(text: str) -> None:
    with pytest.raises(UnitError):
        parse_unit(text)


@pytest.mark.parametrize(
    ("dimension", "shown"),
    [
        (NUMBER, "number"),
        (LENGTH, "mm"),
        (Dimension(1, -1), "mm/s"),
        (Dimension(1, -2), "mm/s^2"),
        (Dimension(0, -1), "s^-1"),
        (Dimension(0, -1, 1), "deg/s"),
        (Dimension(2, 1, -1), "mm^2*s/deg"),
        (Dimension(-1, -2), "mm^-1*s^-2"),
        (Dimension(1, -1, -1), "mm/s/deg"),
        (Dimension(current=1, time=1), "s*A"),
        (Dimension(temperature=1, time=-1), "degC/s"),
    ],
)
def test_dimensions_are_shown_as_units(dimension: Dimension, shown: str) -> None:
    assert str(dimension) == shown
    if dimension != NUMBER:
        assert parse_unit(shown).dimension == dimension


_EXPONENT = st.integers(-9, 9)
_DIMENSION = st.builds(Dimension, *[_EXPONENT] * len(NUMBER))


@given(_DIMENSION, _DIMENSION)
def test_products_and_quotients_undo_each_other(a: Dimension, b: Dimension) -> None:
    assert a.times(b).over(b) == a
    assert a.times(a) == a.power(2)
    assert NUMBER.over(a) == a.power(-1)


@given(st.sampled_from(sorted(BASE_UNITS)), _EXPONENT)
def test_powers(name: str, exponent: int) -> None:
    one, unit = parse_unit(name), parse_unit(f"{name}^{exponent}")
    assert unit.dimension == one.dimension.power(exponent)
    assert unit.factor == one.factor**exponent


@pytest.mark.parametrize(
    ("seconds", "ns"),
    [
        (0.0, 0),
        (0.05, 50_000_000),
        (1e-9, 1),
        (2.0**-10, 976562),  # 976562.5: halves to even
        (3 * 2.0**-10, 2929688),  # 2929687.5
        (-1.5, -1_500_000_000),
        (1e9, 10**18),
    ],
)
def test_nanoseconds(seconds: float, ns: int) -> None:
    assert nanoseconds(seconds) == ns


@pytest.mark.parametrize(
    "unit", ["kg", "N", "W", "Wh", "Ah", "Hz", "mm", "mm/s", "deg/s^2", "A*V/mm^2", "degC"]
)
def test_a_unit_is_shown_as_people_write_it(unit: str) -> None:
    assert readable_unit(parse_unit(unit).dimension) == parse_unit(unit)


def test_what_has_no_unit_is_shown_as_a_number() -> None:
    assert readable_unit(NUMBER) == ("number", NUMBER, 1)


@given(st.integers(0, 10**15))
def test_whole_milliseconds_stay_whole(milliseconds: int) -> None:
    assert abs(nanoseconds(milliseconds / 1000) - milliseconds * 10**6) <= milliseconds * 10**6 / 2**52
