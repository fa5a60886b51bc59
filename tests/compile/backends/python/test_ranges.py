"""Between what bounds values lie: always right, and sharp where it decides which Python is written."""

from __future__ import annotations

from math import inf, isnan, nan
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.compile.backends.python.text import NumberRange, ranges
from colony.execute.code import Kind
from colony.execute.machine import OpMachine
from colony.ir.frame import Frame
from colony.verify.testing.strategies import traces
from tests.case_files import table
from tests.drawn.strategies import programs
from tests.programs import lowered

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


def found(expression: str, at: int = 0) -> NumberRange:
    """Return the range of what is sent to an actuator."""
    code = lowered(TEXT % ("deg" if "atan2" in expression else "number", expression))
    (field,) = code.actuators[at].clients[0].fields
    return ranges(code)[field]


@pytest.mark.parametrize(("expression", "expected"), table(Path(__file__).parent / "cases" / "ranges.table"))
def test_the_range_of(expression: str, expected: str) -> None:
    of = found(expression)
    assert f"{of.low!r} .. {of.high!r}{' or nan' if of.nan else ''}" == expected


def test_a_sum_over_a_condition() -> None:
    of = found("sum(k for k in 1 .. 3 if x > k)")
    assert of.low >= 0.0
    assert of.finite


def test_members_of_an_enum_bound_it() -> None:
    assert found("1", at=1) == NumberRange(-3.0, 67.0, False)


@pytest.mark.parametrize(
    ("of", "finite", "nonzero"),
    [
        (NumberRange(-1.0, 2.0, False), True, False),
        (NumberRange(1.0, 2.0, False), True, True),
        (NumberRange(-2.0, -1.0, False), True, True),
        (NumberRange(0.0, 2.0, False), True, False),
        (NumberRange(-2.0, 0.0, False), True, False),
        (NumberRange(-2.0, -0.0, False), True, False),
        (NumberRange(1.0, inf, False), False, True),
        (NumberRange(-inf, -1.0, False), False, True),
        (NumberRange(1.0, 2.0, True), False, True),
    ],
)
def test_finite_and_nonzero(of: NumberRange, finite: bool, nonzero: bool) -> None:
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
    assert NumberRange(1.0, 2.0, False).within(low, high) is inside
    assert not NumberRange(1.0, 2.0, True).within(low, high)


@given(data=st.data())
def test_every_value_lies_in_its_range(data: st.DataObject) -> None:
    program = data.draw(programs())
    code = lowered(program)
    known, machine = ranges(code), OpMachine(code)
    for frame in data.draw(traces(program)):
        machine.begin(Frame(frame.t_ns, frame.readings))
        machine.run()
        for at in range(code.decided):
            if code.kinds[at] is Kind.NUMBER:
                value, of = machine.values[at], known[at]
                assert of.nan if isnan(value) else of.low <= value <= of.high, (code.ops[at], value, of)
        machine.commit()
