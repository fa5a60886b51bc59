"""All contracts of the shipped behaviors are proved, those of imported files among them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from colony.dsl.load import load_file
from colony.ir.expression import IsIdle
from colony.ir.program import Contract, Program
from colony.ir.types import BOOL
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import Proved, Refuted
from tests.paths import BEHAVIORS
from tests.sampling import sampled

_CANARY = "canary"


def with_canary(program: Program) -> Program:
    """The program with a contract that only robots without a network keep: the first actuator is idle."""
    idle = IsIdle(type=BOOL, actuator=program.robot.actuators[0].name)
    return replace(program, contracts=(*program.contracts, Contract(name=_CANARY, expression=idle)))


@pytest.mark.parametrize("path", sampled(BEHAVIORS, every=3), ids=lambda p: p.stem)
def test_every_contract_is_proved_and_what_is_wrong_refuted(path: Path) -> None:
    program = with_canary(load_file(path))
    *results, canary = prove_contracts(program)
    assert len(results) >= 2
    assert [r.contract.name for r in results if not isinstance(r, Proved)] == []
    assert isinstance(canary, Refuted if any(w.actuator for w in program.wires) else Proved)
