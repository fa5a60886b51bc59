"""The range of each operator, exactly: what may be infinite, zero or NaN decides which Python is written."""

from __future__ import annotations

from math import inf, nan

import pytest

from colony.compile.backends.python.ranges import ANYTHING, Range, ranges
from colony.compile.lower.lower import lower
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text

TEXT = """
enum goal { none = 2, corner = 67, light = -3 }
robot r {
  sensor x    : number range -1 .. 4    from DServer.x
  sensor p    : number range 2 .. 8     from DServer.p
  sensor n    : number range -8 .. -3   from DServer.n
  sensor nz   : number range -8 .. 0    from DServer.nz
  sensor zp   : number range 0 .. 5     from DServer.zp
  sensor free : number                  from DServer.free
  sensor far  : number range 1 .. 1e308 from DServer.far
  sensor a[3] : number range 1 .. 9     from DServer.a
  sensor open[3] : number               from DServer.open
  sensor odd[2] : number range 3 .. 4 default 3.5 from DServer.odd
  sensor b    : bool                    from DServer.b
  sensor bs[3] : bool                   from DServer.bs
  sensor g    : goal                    from DServer.g
  sensor turn : deg range -90 .. 90     from DServer.turn
  sensor wild : deg                     from DServer.wild
  actuator out { v : %s } to DServer.Out idle hold
  actuator way { g : goal } to DServer.Way idle hold
}
module m { when true  do out(v = %s) }
module w { when true  do way(g = g) }
network { out = m  way = w }
"""
UNKNOWN = "sqrt(x)"
"""From 0 to 2, or NaN."""


def found(expression: str) -> Range:
    program = load_text(TEXT % ("deg" if "atan2" in expression else "number", expression))
    code = lower(program, compile_program(program).clients)
    (field,) = code.actuators[0].clients[0].fields
    return ranges(code)[field]


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("0.5 + 0.25", Range(0.75, 0.75, False)),
        ("free", Range(-inf, inf, False)),
        ("odd[0]", Range(3.0, 4.0, False)),
        ("a[1]", Range(1.0, 9.0, False)),
        # sums
        ("x + n", Range(-9.0, 1.0, False)),
        ("sum(a) + sum(x, p, n)", Range(-4.0, 36.0, False)),
        (f"x + {UNKNOWN}", Range(-1.0, 6.0, True)),
        ("abs(free) + (-abs(open[0]))", Range(-inf, inf, True)),
        ("(-abs(open[0])) + abs(free)", Range(-inf, inf, True)),
        ("abs(free) + abs(open[0])", Range(0.0, inf, False)),
        (f"{UNKNOWN} + x", Range(-1.0, 6.0, True)),
        (f"x - {UNKNOWN}", Range(-3.0, 4.0, True)),
        (f"-{UNKNOWN}", Range(-2.0, -0.0, True)),
        ("free + free", ANYTHING),
        ("far - far", Range(-1e308, 1e308, False)),
        ("(far + far) - x", Range(-2.0, inf, False)),
        ("(far + far) - (far + far)", ANYTHING),
        ("(far + far) + -(far + far)", ANYTHING),
        ("x - (far + far)", Range(-inf, 2.0, False)),
        # products
        ("x * n", Range(-32.0, 8.0, False)),
        ("n * n", Range(9.0, 64.0, False)),
        (f"x * {UNKNOWN}", ANYTHING),
        (f"{UNKNOWN} * x", ANYTHING),
        ("x * free", ANYTHING),
        ("free * x", ANYTHING),
        ("a[0] / max(p, 2)", Range(0.125, 4.5, False)),
        ("x / min(n, -3)", Range(-4.0 / 3.0, 1.0 / 3.0, False)),
        ("x / zp", ANYTHING),
        ("x / nz", ANYTHING),
        (f"{UNKNOWN} / max(p, 2)", ANYTHING),
        ("free / max(p, 2)", ANYTHING),
        # the least and the greatest
        ("min(x, p, n)", Range(-8.0, -3.0, False)),
        ("max(x, p, 1)", Range(2.0, 8.0, False)),
        (f"min({UNKNOWN}, x)", Range(-1.0, 2.0, True)),
        (f"max(x, {UNKNOWN})", Range(0.0, 4.0, True)),
        # choices
        ("if b then x else max(p, 6)", Range(-1.0, 8.0, False)),
        (f"if b then n else {UNKNOWN}", Range(-8.0, 2.0, True)),
        ("a[x]", Range(1.0, 9.0, False)),
        ("a[free]", Range(1.0, 9.0, True)),
        ("open[x]", Range(-inf, inf, False)),
        ("if g == goal.light then 1 else 0", Range(0.0, 1.0, False)),
        # counts and indices
        ("count(bs)", Range(0.0, 3.0, False)),
        ("index_of_min(open)", Range(0.0, 2.0, False)),
        ("index_of_max(a)", Range(0.0, 2.0, False)),
        ("now / 1 s", Range(0.0, 1e300, False)),
        # of one
        ("abs(x)", Range(0.0, 4.0, False)),
        ("abs(min(n, -3))", Range(3.0, 8.0, False)),
        ("abs(max(p, 2))", Range(2.0, 8.0, False)),
        ("abs(nz)", Range(0.0, 8.0, False)),
        ("abs(zp)", Range(0.0, 5.0, False)),
        (f"abs({UNKNOWN})", Range(0.0, 2.0, True)),
        ("sign(x)", Range(-1.0, 1.0, False)),
        (f"sign({UNKNOWN})", Range(-1.0, 1.0, True)),
        ("sqrt(zp)", Range(0.0, 5.0**0.5, False)),
        ("sqrt(n)", Range(0.0, 0.0, True)),
        (f"sqrt({UNKNOWN})", Range(0.0, 2.0**0.5, True)),
        ("floor(x / 2)", Range(-1.0, 2.0, False)),
        ("ceil(max(x, 0.5))", Range(1.0, 4.0, False)),
        ("round(x * 0.75)", Range(-1.0, 3.0, False)),
        (f"floor({UNKNOWN})", Range(0.0, 2.0, True)),
        (f"ceil({UNKNOWN})", Range(0.0, 2.0, True)),
        (f"round({UNKNOWN})", Range(0.0, 2.0, True)),
        ("sin(turn)", Range(-1.0, 1.0, False)),
        ("cos(turn)", Range(-1.0, 1.0, False)),
        ("sin(wild)", Range(-1.0, 1.0, True)),
        ("cos(max(wild, turn))", Range(-1.0, 1.0, True)),
        ("sin(min(wild, turn))", Range(-1.0, 1.0, True)),
        (f"cos({UNKNOWN} * 1 deg)", Range(-1.0, 1.0, True)),
        ("atan2(x, p)", Range(-180.0, 180.0, False)),
        (f"atan2({UNKNOWN}, p)", Range(-180.0, 180.0, True)),
        (f"atan2(p, {UNKNOWN})", Range(-180.0, 180.0, True)),
        ("mod(x, max(p, 2))", Range(0.0, 8.0, False)),
        ("mod(x, p / 4)", Range(0.0, 2.0, False)),
        ("mod(x, zp)", ANYTHING),
        ("mod(x, n)", ANYTHING),
        ("mod(free, max(p, 2))", Range(0.0, 8.0, True)),
        ("mod(max(free, 1), max(p, 2))", Range(0.0, 8.0, True)),
        (f"mod({UNKNOWN}, max(p, 2))", Range(0.0, 8.0, True)),
        ("mod(x, max(free, 1))", ANYTHING),
        ("previous(x, 1)", ANYTHING),
    ],
)
def test_the_range_of(expression: str, expected: Range) -> None:
    assert repr(found(expression)) == repr(expected)


def test_members_of_an_enum_bound_it() -> None:
    program = load_text(TEXT % ("number", "1"))
    code = lower(program, compile_program(program).clients)
    (field,) = code.actuators[1].clients[0].fields
    assert ranges(code)[field] == Range(-3.0, 67.0, False)


@pytest.mark.parametrize(
    ("of", "finite", "nonzero"),
    [
        (Range(-1.0, 2.0, False), True, False),
        (Range(1.0, 2.0, False), True, True),
        (Range(-2.0, -1.0, False), True, True),
        (Range(0.0, 2.0, False), True, False),
        (Range(-2.0, 0.0, False), True, False),
        (Range(-2.0, -0.0, False), True, False),
        (Range(1.0, inf, False), False, True),
        (Range(-inf, -1.0, False), False, True),
        (Range(1.0, 2.0, True), False, True),
    ],
)
def test_finite_and_nonzero(of: Range, finite: bool, nonzero: bool) -> None:
    assert (of.finite, of.nonzero) == (finite, nonzero)


@pytest.mark.parametrize(
    ("low", "high", "inside"),
    [
        (None, None, True),
        (1.0, 2.0, True),
        (1.5, 2.0, False),
        (1.0, 1.5, False),
        (None, 2.0, True),
        (None, 1.5, False),
        (1.0, None, True),
        (1.5, None, False),
        (nan, None, False),
    ],
)
def test_within(low: float | None, high: float | None, inside: bool) -> None:
    assert Range(1.0, 2.0, False).within(low, high) is inside
    assert not Range(1.0, 2.0, True).within(low, high)
