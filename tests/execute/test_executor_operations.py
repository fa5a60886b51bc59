"""Every operator and function against small tables, in every executor, to the bit."""

from __future__ import annotations

import struct
from math import cos, inf, nan, pi, sin

import pytest

from colony.compile.backends.python.generate import generate, load
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.executor import ClientListExecutor
from colony.ir.frame import Frame
from colony.verify.reference.interpreter import Interpreter

FRAME = {
    "x": 2.5,
    "y": -4.0,
    "zero": 0.0,
    "up": inf,
    "down": -inf,
    "a": [3.0, 1.0, 2.0, 1.0, 5.0],
    "n": [-0.0, 0.0],
    "p": True,
    "q": False,
    "flags": [True, False, True],
}

# `zero - zero * up` is how a NaN is made.
TABLE: list[tuple[str, float]] = [
    ("x + y", -1.5),
    ("x - y", 6.5),
    ("x * y", -10.0),
    ("x / y", -0.625),
    ("-x", -2.5),
    ("-zero", -0.0),
    ("x / zero", inf),
    ("y / zero", -inf),
    ("x / -zero", -inf),
    ("zero / zero", nan),
    ("up - up", nan),
    ("up * zero", nan),
    ("x / up", 0.0),
    ("y / up", -0.0),
    ("(up - up) / zero", nan),
    ("abs(y)", 4.0),
    ("abs(-zero)", 0.0),
    ("sign(y)", -1.0),
    ("sign(x)", 1.0),
    ("sign(-zero)", 0.0),
    ("sign(up - up)", nan),
    ("sqrt(x * x)", 2.5),
    ("sqrt(y)", nan),
    ("sqrt(-zero)", -0.0),
    ("sqrt(up)", inf),
    ("floor(x)", 2.0),
    ("floor(-x)", -3.0),
    ("floor(-zero)", -0.0),
    ("ceil(x)", 3.0),
    ("ceil(-0.5 * x / x)", -0.0),
    ("round(x)", 2.0),
    ("round(x + 1)", 4.0),
    ("round(-x / 10)", -0.0),
    ("round(up)", inf),
    ("floor(down)", -inf),
    ("ceil(up - up)", nan),
    ("mod(x, y)", -1.5),
    ("mod(y, x)", 1.0),
    ("mod(x, zero)", nan),
    ("mod(up, x)", nan),
    ("mod(x, up)", 2.5),
    ("mod(y, up)", inf),
    ("clamp(x, 0, 1)", 1.0),
    ("clamp(y, 0, 1)", 0.0),
    ("clamp(x, y, 10)", 2.5),
    ("clamp(up - up, 0, 1)", nan),
    ("clamp(x, 5, 1)", 1.0),
    ("sin(30 deg)", sin(30.0 * (pi / 180.0))),
    ("cos(x * 1 deg)", cos(2.5 * (pi / 180.0))),
    ("sin(up * 1 deg)", nan),
    ("atan2(x, x) / 1 deg", 45.0),
    ("atan2(-zero, y) / 1 deg", -180.0),
    ("angle_difference(10 deg, 350 deg) / 1 deg", 20.0),
    ("angle_difference(0 deg, 180 deg) / 1 deg", 180.0),
    ("angle_difference(x * 1 deg, 10 deg) / 1 deg", -7.5),
    ("angle_difference(up * 1 deg, 1 deg) / 1 deg", nan),
    ("min(a)", 1.0),
    ("max(a)", 5.0),
    ("min(n)", -0.0),
    ("max(n)", -0.0),
    ("min(zero, -zero)", 0.0),
    ("min(x, y, zero)", -4.0),
    ("min(x, up - up)", nan),
    ("max(up - up, x)", nan),
    ("sum(a)", 12.0),
    ("sum(n)", 0.0),
    ("sum(n[0..0])", -0.0),
    ("sum(a * 0.1)", 0.1 * 3 + 0.1 * 1 + 0.1 * 2 + 0.1 * 1 + 0.1 * 5),
    ("mean(a)", 2.4),
    ("count(flags)", 2.0),
    ("count(a < 2.5)", 3.0),
    ("index_of_min(a)", 1.0),
    ("index_of_max(a)", 4.0),
    ("index_of_min(a[4..1])", 1.0),
    ("index_of_max(a[2..3])", 2.0),
    ("index_of_min(window(a, 4, 1))", 3.0),
    ("index_of_min(window(a, x, 1))", 1.0),
    ("index_of_max(window(a, up, 1))", nan),
    ("index_of_min(sqrt(a - 2))", 2.0),
    ("index_of_max(sqrt(a - 9))", 0.0),
    ("a[1]", 1.0),
    ("a[x]", 2.0),
    ("a[x + 1]", 5.0),
    ("a[y]", 1.0),
    ("a[-0.4]", 3.0),
    ("a[up]", nan),
    ("sum(window(a, 0, 1))", 9.0),
    ("sum(window(a, x * 1000000000000000001, 2))", 12.0),
    ("sum(window(a, down, 1))", nan),
    ("sum(k for k in 1 .. 4)", 10.0),
    ("sum(k for k in 1 .. 4 if a[k] > 1)", 6.0),
    ("sum(a[k] * k for k in 0 .. 4 if k != 2)", 24.0),
    ("sum(-zero for k in 1 .. 2 if k > 1)", -0.0),
    ("sum(k for k in 1 .. 0)", 0.0),
    ("count(p for k in 1 .. 0)", 0.0),
    ("min(k for k in 1 .. 0)", nan),
    ("mean(k for k in 1 .. 3 if k > x)", 3.0),
    ("mean(k for k in 1 .. 3 if k > 3)", nan),
    ("min(a[k] for k in 0 .. 4 if a[k] > x)", 3.0),
    ("max(a[k] for k in 0 .. 4 if a[k] < zero)", nan),
    ("min(sum(j * k for j in 1 .. 2) for k in 2 .. 3)", 6.0),
    ("if p then x else y", 2.5),
    ("if q then x else if p then y else zero", -4.0),
]

TRUTHS: list[tuple[str, bool]] = [
    ("x < y", False),
    ("y < x", True),
    ("x <= x", True),
    ("x > y", True),
    ("x >= 3", False),
    ("zero == -zero", True),
    ("zero != -zero", False),
    ("up - up == up - up", False),
    ("up - up != up - up", True),
    ("up - up < x", False),
    ("up - up >= x", False),
    ("not (up - up < x)", True),
    ("x in 2.5 .. 3", True),
    ("x in 0 .. 2.5", True),
    ("x in 3 .. 2", False),
    ("p and q", False),
    ("p or q", True),
    ("p implies q", False),
    ("q implies p", True),
    ("p == q", False),
    ("p != q", True),
    ("any(flags)", True),
    ("all(flags)", False),
    ("any(flags and q)", False),
    ("all(flags or p)", True),
    ("flags[x]", True),
    ("flags[1]", False),
    ("flags[up]", False),
    ("flags[y]", True),
    ("any(a[k] == 5 for k in 0 .. 3)", False),
    ("all(a[k] < 5 for k in 0 .. 4 if k < 4)", True),
    ("any(p for k in 1 .. 0)", False),
    ("all(q for k in 1 .. 0)", True),
    ("if p then q else p", False),
]

PROGRAM = """
robot r {
  sensor x : number from DServer.x
  sensor y : number from DServer.y
  sensor zero : number from DServer.zero
  sensor up : number from DServer.up
  sensor down : number from DServer.down
  sensor a[5] : number from DServer.a
  sensor n[2] : number from DServer.n
  sensor p : bool from DServer.p
  sensor q : bool from DServer.q
  sensor flags[3] : bool from DServer.flags
  actuator out { finite : number, nan : bool, up : bool } to DServer.Out idle hold
}
%s
module m { when true  do out(finite = if e - e == 0 then e else 0, nan = e != e, up = e > 0) }
network { out = m }
"""


def _executors(text: str) -> dict[str, object]:
    program = load_text(text)
    clients = compile_program(program).clients
    return {
        "clients": ClientListExecutor(program, clients),
        "generated": load(generate(program, clients)),
        "interpreter": Interpreter(program),
    }


def _bits(value: float) -> bytes:
    return struct.pack("<d", value)


@pytest.mark.parametrize(("expression", "expected"), TABLE, ids=[row[0] for row in TABLE])
def test_numbers(expression: str, expected: float) -> None:
    for name, executor in _executors(PROGRAM % f"let e = {expression}").items():
        (decision,) = executor.step(Frame(0, FRAME)).decisions
        finite, is_nan, is_up = decision.values
        if expected - expected == 0:
            assert _bits(finite) == _bits(expected), name
        assert (is_nan, is_up) == (expected != expected, expected > 0), name


@pytest.mark.parametrize(("expression", "expected"), TRUTHS, ids=[row[0] for row in TRUTHS])
def test_bools(expression: str, expected: bool) -> None:
    for name, executor in _executors(PROGRAM % f"let e = if {expression} then 1 else 0").items():
        (decision,) = executor.step(Frame(0, FRAME)).decisions
        assert decision.values[0] == expected, name


def test_arrays_and_scalars_go_together_element_by_element() -> None:
    text = PROGRAM % "let b = if p then a * 2 + a else a\nlet e = sum(b[k] * 10 for k in 0 .. 4) + max(x + n)"
    for executor in _executors(text).values():
        assert executor.step(Frame(0, FRAME)).decisions[0].values[0] == 362.5


def test_whole_numbers_are_as_good_as_floats() -> None:
    frame = FRAME | {"x": 5, "a": [3, 1, 2, 1, 5]}
    for executor in _executors(PROGRAM % "let e = x / 2 + a[0]").values():
        (decision,) = executor.step(Frame(0, frame)).decisions
        assert repr(decision.values[0]) == "5.5"
