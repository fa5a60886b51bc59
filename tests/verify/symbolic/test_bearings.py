"""Elements along an angle as formulas, at and beside the floats where the nearest one changes."""

from __future__ import annotations

import math

import pytest

from colony.dsl.load import load_text
from colony.ir.bearings import lookup
from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.ir.types import Array
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import Proved
from tests.verify.symbolic.trust import held_against

RANGE = "range -360 .. 359"


def program(bearing: str, range_: str = RANGE) -> Program:
    return load_text(
        f"""robot r {{
  sensor s[7] : number bearing {bearing} from D.s
  sensor a : deg {range_} from D.a
  actuator out {{ v : number }} to D.o idle hold
}}
module m {{ when true do out(v = value_or(s[a], -1)) }}
network {{ out = m }}
contract least: s[a] < 3 or true
"""
    )


def trace(of: Program) -> tuple[Frame, ...]:
    """Frames with angles at and beside each break, positive and negative."""
    type_ = next(s.type for s in of.robot.sensors if s.name == "s")
    assert isinstance(type_, Array)
    assert type_.bearings is not None
    angles = [x for b in lookup(type_.bearings).breaks for x in (b, b - 360)]
    angles = [y for x in angles for y in (x, math.nextafter(x, 999), math.nextafter(x, -999), -x)]
    angles += [0.0, -0.0, -5e-324, -1e-20, -1e-14, -360.0, 359.0]
    readings = [float(i) for i in range(7)]
    return tuple(Frame(i * 50_000_000, {"s": readings, "a": a}) for i, a in enumerate(angles))


@pytest.mark.parametrize("range_", [RANGE, "range -90 .. 90", "range 0 .. 359", ""])
@pytest.mark.parametrize(
    "bearing",
    [
        "0 deg",
        "-180 deg",
        "0.1 deg step -0.3 deg",
        "-45 deg step 15 deg",
        "[0 deg, 50 deg, 0 deg, -7.3 deg, 170 deg, 171 deg, -20 deg]",
    ],
)
def test_formulas_and_interpreter_agree(bearing: str, range_: str) -> None:
    of = program(bearing, range_)
    tally = held_against(of, trace(of))
    assert tally.differences == []
    assert tally.exact > 0


def test_of_bounded_angles_the_proof_is_about_floats() -> None:
    of = load_text(
        """robot r {
  sensor s[7] : number bearing -45 deg step 15 deg range 0 .. 9 from D.s
  sensor a : deg range -52 .. 52 from D.a
  actuator out { v : number } to D.o idle out(v = 0)
}
module m { when true do out(v = s[a]) }
network { out = m }
contract inside: value_or(s[a], if fresh(s) and fresh(a) then 10 else 0) < 10
"""
    )
    [result] = prove_contracts(of)
    assert isinstance(result, Proved)
    assert result.over_reals == ()
