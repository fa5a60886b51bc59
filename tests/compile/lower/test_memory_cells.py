"""Cells begin with a value of their kind that stands for nothing, and every value has a kind."""

from __future__ import annotations

import pytest

from colony.execute.code import Kind
from tests.programs import lowered

TEXT = """
robot r {
  sensor x : number from DServer.x
  sensor b : bool from DServer.b
  actuator out { v : bool } to DServer.out idle hold
}
module m { when true do out(v = %s) }
network { out = m }
"""
CALLS = (
    *(
        "changed(x)",
        "changed(b)",
        "rising(b)",
        "falling(b)",
        "recently(b, 1 s)",
        "elapsed(b) > 1 s",
        "latch(b, x > 1)",
    ),
    *(
        "captured(x, b) > 1",
        "captured(b, x)",
        "captured(b, b)",
        "captured(x, x) > 1",
        "every(1 s)",
        "now > 1 s",
    ),
)
TYPES = {Kind.BOOL: bool, Kind.NUMBER: float, Kind.TIME: int}


@pytest.mark.parametrize("expression", CALLS)
def test_cells_begin_with_nothing_of_their_kind(expression: str) -> None:
    code = lowered(TEXT % expression)
    assert all(isinstance(kind, Kind) for kind in code.kinds)
    for cell in code.cells:
        assert type(cell.initial) is TYPES[cell.kind]
        assert not cell.initial
        assert code.kinds[cell.value] is cell.kind
        assert code.kinds[cell.condition] is Kind.BOOL


@pytest.mark.parametrize(
    ("expression", "initial"), [("previous(x, 7) > 1", 7.0), ("previous(b, true)", True)]
)
def test_previous_begins_with_what_is_given(expression: str, initial: float | bool) -> None:
    assert repr(initial) in [repr(cell.initial) for cell in lowered(TEXT % expression).cells]
