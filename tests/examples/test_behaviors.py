"""The behaviors of the examples are right: no finding, their tests pass, their contracts are proved."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.dsl.load import check_file
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import ProofOptions, Proved
from colony.verify.testing.examples import run_examples
from tests.examples.stage import ROOT

SLOW = ("closed_loop",)
"""The behaviors with contracts that take seconds to prove."""
BEHAVIORS = [
    pytest.param(path, marks=pytest.mark.long if path.stem in SLOW else (), id=path.stem)
    for path in sorted((ROOT / "examples").rglob("*.colony"))
]


@pytest.mark.parametrize("path", BEHAVIORS)
def test_a_behavior_is_right(path: Path) -> None:
    checked = check_file(path)
    assert checked.diagnostics == ()
    assert checked.program is not None
    results = run_examples(checked.program)
    assert results
    assert [result.failures for result in results] == [()] * len(results)
    assert checked.program.contracts
    verdicts = {r.contract.name: r for r in prove_contracts(checked.program, ProofOptions())}
    assert {name: type(r) for name, r in verdicts.items()} == dict.fromkeys(verdicts, Proved)
