"""Functions and operators, each by hand, down to NaN and the sign of zero."""

from __future__ import annotations

import math

import pytest

from tests.verify.stepping import value

NAN, INF = math.nan, math.inf


def same(found: object, expected: object) -> bool:
    """Bit for bit, NaN equal to NaN."""
    return repr(found) == repr(expected)


CASES: list[tuple[str, dict[str, object], object]] = [
    # division: IEEE 754
    ("x / y", {"x": 1.0, "y": 0.0}, INF),
    ("x / y", {"x": 1.0, "y": -0.0}, -INF),
    ("x / y", {"x": -1.0, "y": 0.0}, -INF),
    ("x / y", {"x": INF, "y": -0.0}, -INF),
    ("x / y", {"x": 0.0, "y": 0.0}, NAN),
    ("x / y", {"x": -0.0, "y": 4.0}, -0.0),
    ("x * y", {"x": 1e300, "y": 1e300}, INF),
    ("-x", {"x": 0.0}, -0.0),
    ("x - x", {"x": INF}, NAN),
    # comparisons: false with NaN, but != true
    ("(x - x) < y", {"x": INF, "y": 1.0}, False),
    ("(x - x) >= y", {"x": INF, "y": 1.0}, False),
    ("(x - x) == (x - x)", {"x": INF}, False),
    ("(x - x) != (x - x)", {"x": INF}, True),
    ("x == y", {"x": 0.0, "y": -0.0}, True),
    ("x in 1 .. 2", {"x": 1.0}, True),
    ("x in 1 .. 2", {"x": 2.0}, True),
    ("x in 1 .. 2", {"x": 2.5}, False),
    ("x in 2 .. 1", {"x": 1.5}, False),
    ("feel == mood.alert", {"feel": 67}, True),
    ("feel != mood.alert", {"feel": 67}, False),
    ("a implies b", {"a": False, "b": False}, True),
    ("a implies b", {"a": True, "b": False}, False),
    ("if a then x else y", {"a": True, "x": 1.0, "y": 2.0}, 1.0),
    # min and max: the first of equals, NaN where any is
    ("min(x, y)", {"x": 0.0, "y": -0.0}, 0.0),
    ("min(x, y)", {"x": -0.0, "y": 0.0}, -0.0),
    ("max(x, y)", {"x": -0.0, "y": 0.0}, -0.0),
    ("min(x - x, y)", {"x": INF, "y": 1.0}, NAN),
    ("max(y, x - x)", {"x": INF, "y": 1.0}, NAN),
    ("min(four)", {"four": (3.0, 1.0, 2.0, 1.0)}, 1.0),
    ("clamp(x, 0, 1)", {"x": 5.0}, 1.0),
    ("clamp(x, 0, 1)", {"x": -5.0}, 0.0),
    ("clamp(x, 3, 1)", {"x": 2.0}, 1.0),  # min(max(x, lo), hi): the upper bound wins
    ("clamp(x, 0, 1)", {"x": -0.0}, -0.0),
    # sums go from the left, from the first
    ("sum(four)", {"four": (1e16, 1.0, 1.0, -1e16)}, 0.0),
    ("sum(x, y)", {"x": -0.0, "y": -0.0}, -0.0),
    ("sum(four[k] for k in 0 .. 3 if false)", {"four": (1.0,) * 4}, 0.0),
    ("mean(four)", {"four": (1.0, 2.0, 3.0, 4.0)}, 2.5),
    ("mean(four[k] for k in 0 .. 3 if false)", {"four": (1.0,) * 4}, NAN),
    ("min(four[k] for k in 0 .. 3 if false)", {"four": (1.0,) * 4}, NAN),
    ("max(four[k] for k in 3 .. 2)", {"four": (1.0,) * 4}, NAN),
    ("count(bits)", {"bits": (True, False, True, True)}, 3.0),
    ("count(bits[k] for k in 0 .. 3 if k > 2)", {"bits": (True, False, True, True)}, 1.0),
    ("count(bits[k] for k in 1 .. 0)", {"bits": (True,) * 4}, 0.0),
    ("any(bits[k] for k in 1 .. 0)", {"bits": (True,) * 4}, False),
    ("all(bits[k] for k in 1 .. 0)", {"bits": (False,) * 4}, True),
    ("any(a, b)", {"a": False, "b": True}, True),
    ("all(a, b)", {"a": False, "b": True}, False),
    # functions of one number
    ("abs(x)", {"x": -0.0}, 0.0),
    ("sign(x)", {"x": -3.0}, -1.0),
    ("sign(x)", {"x": -0.0}, 0.0),
    ("sign(x - x)", {"x": INF}, NAN),
    ("sqrt(x)", {"x": -1.0}, NAN),
    ("sqrt(x)", {"x": -0.0}, -0.0),
    ("floor(x)", {"x": -0.5}, -1.0),
    ("floor(x)", {"x": -0.0}, -0.0),
    ("ceil(x)", {"x": -0.5}, -0.0),
    ("ceil(x)", {"x": INF}, INF),
    ("round(x)", {"x": 2.5}, 2.0),
    ("round(x)", {"x": 3.5}, 4.0),
    ("round(x)", {"x": -0.5}, -0.0),
    ("round(x - x)", {"x": INF}, NAN),
    ("mod(x, y)", {"x": -1.0, "y": 3.0}, 2.0),
    ("mod(x, y)", {"x": 1.0, "y": -3.0}, -2.0),
    ("mod(x, y)", {"x": 1.0, "y": 0.0}, NAN),
    ("mod(x, y)", {"x": INF, "y": 3.0}, NAN),
    # angles are degrees
    ("sin(angle)", {"angle": 90.0}, 1.0),
    ("cos(angle)", {"angle": 180.0}, -1.0),
    ("sin(angle)", {"angle": INF}, NAN),
    ("atan2(x, y)", {"x": 1.0, "y": 0.0}, 90.0),
    ("atan2(x, y)", {"x": 0.0, "y": -1.0}, 180.0),
    ("angle_difference(angle, 350 deg)", {"angle": 10.0}, 20.0),
    ("angle_difference(angle, 10 deg)", {"angle": 350.0}, -20.0),
    ("angle_difference(angle, 0 deg)", {"angle": 180.0}, 180.0),
    ("angle_difference(angle, 0 deg)", {"angle": -180.0}, 180.0),
    # arrays
    ("four[x]", {"four": (0.0, 1.0, 2.0, 3.0), "x": 1.5}, 2.0),  # halves to even
    ("four[x]", {"four": (0.0, 1.0, 2.0, 3.0), "x": 2.5}, 2.0),
    ("four[x]", {"four": (0.0, 1.0, 2.0, 3.0), "x": -1.0}, 3.0),
    ("four[x]", {"four": (0.0, 1.0, 2.0, 3.0), "x": 4.0}, 0.0),
    ("four[x / 0]", {"four": (0.0, 1.0, 2.0, 3.0), "x": 4.0}, NAN),
    ("bits[x / 0]", {"bits": (True,) * 4, "x": 4.0}, False),
    ("four[2..0]", {"four": (0.0, 1.0, 2.0, 3.0)}, (2.0, 3.0, 0.0)),
    ("four < 2", {"four": (0.0, 1.0, 2.0, 3.0)}, (True, True, False, False)),
    ("four + four", {"four": (0.0, 1.0, 2.0, 3.0)}, (0.0, 2.0, 4.0, 6.0)),
    ("10 - four", {"four": (0.0, 1.0, 2.0, 3.0)}, (10.0, 9.0, 8.0, 7.0)),
    ("not bits", {"bits": (True, False, True, False)}, (False, True, False, True)),
    ("if a then four else x", {"a": False, "four": (1.0,) * 4, "x": 2.0}, (2.0, 2.0, 2.0, 2.0)),
    ("window(four, x, 1)", {"four": (0.0, 1.0, 2.0, 3.0), "x": 0.0}, (3.0, 0.0, 1.0)),
    ("window(four, x / 0, 1)", {"four": (0.0, 1.0, 2.0, 3.0), "x": 1.0}, (NAN, NAN, NAN)),
    ("window(bits, x / 0, 0)", {"bits": (True,) * 4, "x": 1.0}, (False,)),
    # the index of the least: in the whole array; the first of equals; NaN loses
    ("index_of_min(four)", {"four": (3.0, 1.0, 2.0, 1.0)}, 1.0),
    ("index_of_max(four)", {"four": (3.0, 1.0, 3.0, 1.0)}, 0.0),
    ("index_of_min(four[2..0])", {"four": (0.0, -9.0, 2.0, 3.0)}, 0.0),
    ("index_of_max(window(four, x, 1))", {"four": (0.0, 1.0, 9.0, 3.0), "x": 3.0}, 2.0),
    ("index_of_max(window(four, x / 0, 1))", {"four": (0.0, 1.0, 9.0, 3.0), "x": 3.0}, NAN),
    ("index_of_min(four - four)", {"four": (INF, INF, 1.0, INF)}, 2.0),
    ("index_of_min(four - four)", {"four": (INF, INF, INF, INF)}, 0.0),
    # reductions over a variable, which is a number
    ("sum(k * k for k in -1 .. 2)", {}, 6.0),
    ("sum(four[k + 1] for k in 0 .. 1 if four[k] > 0)", {"four": (1.0, 5.0, 7.0, 9.0)}, 12.0),
    ("sum(sum(k * j for j in 1 .. 2) for k in 1 .. 3)", {}, 18.0),
]


@pytest.mark.parametrize(("expression", "readings", "expected"), CASES)
def test_value(expression: str, readings: dict[str, object], expected: object) -> None:
    found = value(expression, **readings)
    assert same(found, expected), f"{expression} of {readings}: {found}, expected {expected}"


def test_units_are_left_outside() -> None:
    assert value("(1 m + 1 cm) / 1 s") == 1010.0
    assert value("180 deg") == 180.0
    assert value("1 rad") == 57.29577951308232
