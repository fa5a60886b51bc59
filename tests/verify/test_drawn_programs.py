"""A sample of `make agreement`."""

from __future__ import annotations

import pytest

from tests.sampling import sampled
from tools.assumed_programs import check as assumed
from tools.drawn_programs import executors, outlined, verdicts


@pytest.mark.parametrize("seed", sampled(range(2, 42), every=20, thorough=True))
def test_drawn_traces_show_what_is_said_of_contracts(seed: int) -> None:
    _, findings = verdicts(seed)
    assert not findings


@pytest.mark.parametrize("seed", sampled(range(2, 42), every=20, thorough=True))
def test_proofs_hold_for_all_values_of_tunable_params(seed: int) -> None:
    for check in (executors, verdicts):
        _, findings = check(seed, tunable=True)
        assert not findings


@pytest.mark.parametrize("seed", sampled(range(40), every=5, thorough=True))
def test_functions_and_inputs_change_nothing(seed: int) -> None:
    _, findings = outlined(seed)
    assert not findings


@pytest.mark.long
@pytest.mark.parametrize("seed", sampled(range(40), every=10, thorough=True))
def test_proofs_hold_up_to_a_broken_assumption(seed: int) -> None:
    _, findings = assumed(seed)
    assert not findings
