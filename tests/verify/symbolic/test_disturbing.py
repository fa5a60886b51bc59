"""The system with disturbances extends the usual one: what was proved of that holds in it."""

from __future__ import annotations

from collections.abc import Iterable

import pytest
import z3

from colony.verify.symbolic.encode import claim_name, encode, encode_disturbed
from colony.verify.symbolic.system import Disturbance
from tests.drawn.strategies import run_of_seed


def ids(formulas: Iterable[z3.ExprRef]) -> set[int]:
    return {formula.get_id() for formula in formulas}


@pytest.mark.parametrize("seed", range(12))
def test_it_extends_the_usual_system(seed: int) -> None:
    usual = encode(run_of_seed(seed)[0])
    disturbed = encode_disturbed(usual)
    cells = {cell.name: cell for cell in disturbed.cells}
    for cell in usual.cells:
        assert cells[cell.name].next.eq(cell.next)
        assert cells[cell.name].initial.eq(cell.initial)
    assert ids(usual.assumptions) <= ids(disturbed.assumptions)
    assert ids(usual.definitions) <= ids(disturbed.definitions)
    assert ids(usual.invariants) <= ids(disturbed.invariants)
    for claim, same in zip(usual.claims, disturbed.claims, strict=False):
        assert claim.holds.eq(same.holds)
    names = {claim.name for claim in disturbed.claims}
    assert names == {c.name for c in usual.claims} | {
        claim_name(c.name, d) for c in usual.claims for d in Disturbance
    }
