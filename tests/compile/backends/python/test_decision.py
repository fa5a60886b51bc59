"""A command is checked for exactly what it could be wrong in: its range, and being finite when it leaves."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import pytest

from colony.dsl.load import load_text
from colony.ir.frame import Frame
from colony.ir.program import Program
from tests.executors import outcomes
from tests.programs import generated
from tests.sampling import sampled

TEXT = """
robot r {
  sensor x : number from DServer.x
  sensor p : number range 2 .. 8 from DServer.p
  sensor far : number range 1 .. 1e308 from DServer.far
  sensor deep : number range -1e308 .. -1 from DServer.deep
  sensor b : bool from DServer.b
  actuator out { v : number, b : bool } to DServer.out idle %s
}
module m { when true do out(v = %s, b = b) }
network { out = m }
"""
HUGE = 1e308


def program(expression: str, low: float | None, high: float | None, factor: float, idle: str) -> Program:
    whole = load_text(TEXT % (idle, expression))
    (actuator,) = whole.robot.actuators
    field = replace(actuator.fields[0], low=low, high=high, factor=factor)
    actuator = replace(actuator, fields=(field, actuator.fields[1]))
    return replace(whole, robot=replace(whole.robot, actuators=(actuator,)))


def check(of: Program) -> str | None:
    """The condition under which a command goes out as it is; None where it always does."""
    text = generated(of)
    found = re.search(r"        elif (.*):\n", text[text.index("class Program") :])
    return None if found is None else found[1]


@pytest.mark.parametrize(
    ("expression", "low", "high", "factor", "expected"),
    [
        ("x", None, None, 1.0, "isfinite(out_v)"),
        ("x", None, None, 1000.0, "isfinite(out_v / 1000.0)"),
        ("x", 1.0, None, 1.0, "1.0 <= out_v and isfinite(out_v)"),
        ("x", None, 9.0, 1.0, "out_v <= 9.0 and isfinite(out_v)"),
        ("x", 1.0, 9.0, 0.001, "1.0 <= out_v <= 9.0"),
        ("x", 1.0, HUGE, 0.001, "1.0 <= out_v <= 1e+308 and isfinite(out_v / 0.001)"),
        ("x", -HUGE, 9.0, 0.001, "-1e+308 <= out_v <= 9.0 and isfinite(out_v / 0.001)"),
        ("x", -HUGE, HUGE, 1000.0, "-1e+308 <= out_v <= 1e+308"),
        ("sqrt(x)", None, None, 1.0, "out_v <= inf and isfinite(out_v)"),
        ("sqrt(x)", 1.0, 9.0, 1.0, "1.0 <= out_v <= 9.0"),
        ("p", None, None, 1.0, None),
        ("p", 2.0, None, 1.0, None),
        ("p", None, 8.0, 1.0, None),
        ("p", 2.0, 8.0, 1000.0, None),
        ("p", 2.5, 8.0, 1.0, "2.5 <= out_v <= 8.0"),
        ("p", 2.0, 7.5, 1.0, "2.0 <= out_v <= 7.5"),
        ("p", 2.5, None, 1.0, "2.5 <= out_v"),
        ("p", None, 7.5, 1.0, "out_v <= 7.5"),
        ("far", None, None, 1000.0, None),
        ("far", None, None, 0.001, "isfinite(out_v / 0.001)"),
        ("deep", None, None, 0.001, "isfinite(out_v / 0.001)"),
        ("deep", None, 9.0, 1000.0, None),
        ("far", -HUGE, HUGE, 0.001, "isfinite(out_v / 0.001)"),
    ],
)
def test_what_is_checked(
    expression: str, low: float | None, high: float | None, factor: float, expected: str | None
) -> None:
    assert check(program(expression, low, high, factor, "hold")) == expected


@pytest.mark.parametrize("idle", ["hold", "out(v = 3, b = true)"])
@pytest.mark.parametrize("factor", sampled([0.001, 1.0, 1000.0], every=3))
@pytest.mark.parametrize("low", [None, -HUGE, 1.0, 3.0])
@pytest.mark.parametrize("high", [None, HUGE, 9.0, 7.0])
def test_what_is_sent(low: float | None, high: float | None, factor: float, idle: str) -> None:
    for expression in ("x", "sqrt(x)", "p", "far", "deep", "x / 0"):
        of = program(expression, low, high, factor, idle)
        values = (-math.inf, -HUGE, -2.0, 0.0, 2.0, 5.0, 8.0, 80.0, HUGE, math.inf)
        trace = [
            Frame(at, dict.fromkeys(("x", "p", "far", "deep"), value) | {"b": at % 2 == 0})
            for at, value in enumerate(values)
        ]
        outcomes(of, [*trace, Frame(99, {})])
