"""Memory of enumerators, which are NaN after an element that was outside."""

from __future__ import annotations

import pytest

from colony.dsl.load import load_text
from colony.ir.frame import Frame
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import Proved, Refuted
from tests.verify.symbolic.trust import held_against

ROBOT = """enum mood { calm = 0, alert = 67 }
enum only { one = 7 }
robot r {
  sensor moods[2] : mood from D.moods
  sensor ones[2] : only from D.ones
  sensor i : number from D.i
  actuator out { v : number } to D.o idle out(v = 0)
}
module m { when true do out(v = 0) }
network { out = m }
"""


@pytest.mark.parametrize(
    ("memory", "member"),
    [
        ("state s = mood.calm\nnext s = moods[i]", "s == mood.calm or s == mood.alert"),
        ("state s = only.one\nnext s = ones[i]", "s == only.one"),
        ("let s = value_or(previous(moods[i], mood.calm), mood.calm)", "s == mood.calm or s == mood.alert"),
        ("let s = value_or(captured(moods[i], i > 5), mood.calm)", "s == mood.calm or s == mood.alert"),
    ],
)
def test_what_is_remembered_may_be_no_member(memory: str, member: str) -> None:
    of = load_text(ROBOT + memory + f"\ncontract member: {member}\n")
    readings = {"moods": [67.0, 0.0], "ones": [7.0, 7.0]}
    trace = tuple(Frame(k * 50_000_000, {**readings, "i": i}) for k, i in enumerate((0.0, 2.0, 1.0, 0.0)))
    assert held_against(of, trace).differences == []
    [result] = prove_contracts(of)
    assert isinstance(result, Refuted)


def test_what_is_inside_is_a_member() -> None:
    text = "state s = mood.calm\nnext s = value_or(moods[i], mood.calm)\n"
    of = load_text(ROBOT + text + "contract member: s == mood.calm or s == mood.alert\n")
    [result] = prove_contracts(of)
    assert isinstance(result, Proved)
