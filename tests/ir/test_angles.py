"""Trigonometry in degrees: what is exact, what is NaN, and never more than one unit in the last place off."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import pytest
from mpmath import mp

from colony.ir import angles
from tools import angles_trial
from tools.angles_trial import HARD, PARTS, inverse_truths, truths, units_off

DEGREES = range(-720, 721, 15)
EXACT = {0: 0.0, 30: 0.5, 90: 1.0, 150: 0.5, 180: 0.0, 210: -0.5, 270: -1.0, 330: -0.5}
"""Sines of the angles up to 360 degrees that have exact ones."""


@pytest.mark.parametrize("degrees", DEGREES)
def test_sines_and_cosines_that_are_exact_are_exact(degrees: int) -> None:
    if degrees % 360 in EXACT:
        assert angles.sine(float(degrees)) == EXACT[degrees % 360]
    if (degrees + 90) % 360 in EXACT:
        assert angles.cosine(float(degrees)) == EXACT[(degrees + 90) % 360]


@pytest.mark.parametrize("k", range(-5, 6))
def test_the_tangent_has_poles_with_signs(k: int) -> None:
    assert angles.tangent(90.0 + 180.0 * k) == (-math.inf if k % 2 else math.inf)
    assert angles.tangent(45.0 + 180.0 * k) == 1.0
    assert angles.tangent(180.0 * k) == 0.0


@pytest.mark.parametrize(
    ("x", "sine", "cosine", "tangent"),
    [(-0.0, "-0.0", "1.0", "-0.0"), (180.0, "0.0", "-1.0", "0.0"), (-360.0, "-0.0", "1.0", "-0.0")],
)
def test_zeros_have_the_sign_of_the_angle(x: float, sine: str, cosine: str, tangent: str) -> None:
    found = repr(angles.sine(x)), repr(angles.cosine(x)), repr(angles.tangent(x))
    assert found == (sine, cosine, tangent)


@pytest.mark.parametrize("x", [math.nan, math.inf, -math.inf])
def test_what_has_no_angle_gives_nan(x: float) -> None:
    of_one = (angles.sine, angles.cosine, angles.tangent, angles.arc_sine, angles.arc_cosine)
    assert all(math.isnan(function(x)) for function in of_one)
    assert math.isnan(angles.direction(math.nan, x))
    assert math.isnan(angles.direction(x, math.nan))


@pytest.mark.parametrize("x", [1.0000000000000002, -1.0000000000000002, 7.0])
def test_sines_and_cosines_end_at_one(x: float) -> None:
    assert math.isnan(angles.arc_sine(x))
    assert math.isnan(angles.arc_cosine(x))


SPECIAL = (0.0, -0.0, 1.0, -1.0, math.inf, -math.inf, 5e-324, -1.7976931348623157e308)


@pytest.mark.parametrize("y", SPECIAL)
@pytest.mark.parametrize("x", SPECIAL)
def test_directions_are_those_of_the_c_library_but_for_zero(y: float, x: float) -> None:
    expected = 0.0 if x == 0.0 == y else math.degrees(math.atan2(y, x))
    assert repr(angles.direction(y, x)) == repr(expected)


def test_hard_cases_are_within_one_unit() -> None:
    mp.prec = 200
    cases = [case for x in HARD for case in truths(x)]
    cases += [case for x in PARTS for y in (0.0, 1.0, -1.0, 1e300, 3e-308) for case in inverse_truths(x, y)]
    off = [(name, x, found) for name, x, found, true in cases if true and units_off(found, true) > 1.0]
    zero = [(name, x, found) for name, x, found, true in cases if not true and found != 0.0]
    assert (off, zero) == ([], [])


def test_drawn_arguments_are_within_one_unit() -> None:
    found = angles_trial.worst((1, 2_000))
    assert found.keys() == {"sin", "cos", "tan", "asin", "acos", "atan2"}
    assert max(off for off, _ in found.values()) < 1.0, found


def test_only_basic_operations_are_used() -> None:
    tree = ast.parse(Path(angles.__file__).read_text(encoding="utf-8"))
    names = {a.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for a in node.names}
    exact = {"copysign", "fmod", "frexp", "inf", "isfinite", "isinf", "ldexp", "nan", "sqrt"}
    assert names == {"annotations", *exact}
