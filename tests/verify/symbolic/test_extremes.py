"""Extremes of many numbers, as constants with axioms."""

from __future__ import annotations

import pytest

from colony.dsl.load import load_text
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import Proved, Refuted
from colony.verify.symbolic import functions

TEXT = """
language 1
robot r {
  frame 100 ms
  sensor r[40] : m range 0 m .. 10 m from X.r
  actuator a { v : m } to X.a idle hold
}
module m { when true do a(v = 0 m) }
network { a = m }
let first = r[0 .. 29][index_of_min(r)]
let least = r[index_of_min(r)]
contract whole: fresh(r) implies least == min(r)
contract part: fresh(r) implies first == min(r)
"""


def test_element_of_a_shorter_array_at_the_index_of_an_extreme_may_be_outside(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(functions, "MANY", 24)
    found = prove_contracts(load_text(TEXT))
    assert [type(result) for result in found] == [Proved, Refuted]
