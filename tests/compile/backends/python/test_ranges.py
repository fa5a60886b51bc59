"""Between what bounds values lie: always right, and sharp enough where it matters."""

from __future__ import annotations

from math import inf, isnan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.compile.backends.python.ranges import ANYTHING, Range, ranges
from colony.compile.lower.lower import lower
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.code import Kind
from colony.execute.machine import Machine
from colony.ir.frame import Frame
from colony.verify.testing.strategies import programs, traces

TEXT = """
robot r {
  sensor x : number range -1 .. 4 from DServer.x
  sensor p : number range 2 .. 8 from DServer.p
  sensor free : number from DServer.free
  sensor far : number range 1 .. 1e308 from DServer.far
  actuator out { v : number } to DServer.Out idle hold
}
module m { when true  do out(v = %s) }
network { out = m }
"""


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("x + p", Range(1.0, 12.0, False)),
        ("x - p", Range(-9.0, 2.0, False)),
        ("x * p", Range(-8.0, 32.0, False)),
        ("x / p", Range(-0.5, 2.0, False)),
        ("p / x", ANYTHING),
        ("-x", Range(-4.0, 1.0, False)),
        ("abs(x)", Range(0.0, 4.0, False)),
        ("min(x, p)", Range(-1.0, 4.0, False)),
        ("max(x, p)", Range(2.0, 8.0, False)),
        ("clamp(x, 0, 1)", Range(0.0, 1.0, False)),
        ("mod(x, p)", Range(0.0, 8.0, False)),
        ("sqrt(p)", Range(2.0**0.5, 8.0**0.5, False)),
        ("sqrt(x)", Range(0.0, 2.0, True)),
        ("floor(x / 3)", Range(-1.0, 1.0, False)),
        ("if x > 0 then x else p", Range(-1.0, 8.0, False)),
        ("free", Range(-inf, inf, False)),
        ("min(free, x)", Range(-inf, 4.0, False)),
        ("free + 1", Range(-inf, inf, False)),
        ("free - free", ANYTHING),
        ("free * 0", ANYTHING),
        ("far + far", Range(2.0, inf, False)),
        ("far * far", Range(1.0, inf, False)),
        ("previous(x, 0)", ANYTHING),
        ("sum(k for k in 1 .. 3 if x > k)", Range(0.0, 6.0, False)),
    ],
)
def test_ranges(expression: str, expected: Range) -> None:
    program = load_text(TEXT % expression)
    code = lower(program, compile_program(program).clients)
    (field,) = code.actuators[0].clients[0].fields
    found = ranges(code)[field]
    if expression.startswith("sum"):
        assert found.low >= 0.0
        assert found.finite
    else:
        assert found == expected


@given(data=st.data())
def test_every_value_lies_in_its_range(data: st.DataObject) -> None:
    program = data.draw(programs())
    code = lower(program, compile_program(program).clients)
    known, machine = ranges(code), Machine(code)
    for frame in data.draw(traces(program)):
        machine.begin(Frame(frame.t_ns, frame.readings))
        machine.run(0, code.decided)
        for at in range(code.decided):
            if code.kinds[at] is Kind.NUMBER:
                value, of = machine.values[at], known[at]
                assert of.nan if isnan(value) else of.low <= value <= of.high, (code.ops[at], value, of)
        machine.commit()
