"""The Navigator as printed: it checks, its examples hold, and its contracts are proved."""

from __future__ import annotations

import pytest

from colony.dsl.load import check_file, load_file
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import Proved
from colony.verify.testing.examples import failures_as_diagnostics, run_examples
from tests.paths import THESIS_NAVIGATOR


def test_the_printed_navigator_checks_and_its_examples_hold() -> None:
    assert check_file(THESIS_NAVIGATOR).diagnostics == ()
    results = run_examples(load_file(THESIS_NAVIGATOR))
    assert len(results) >= 3
    assert failures_as_diagnostics(results) == ()


@pytest.mark.thorough
def test_the_contracts_of_the_printed_navigator_are_proved() -> None:
    results = tuple(prove_contracts(load_file(THESIS_NAVIGATOR)))
    assert len(results) == 13
    assert all(isinstance(result, Proved) for result in results)
