"""All contracts of the shipped behaviors are proved, those of imported files among them.

docs/verification.md has a table of those that are not proved with late clients, or with operators:
`python -m tests.verify.contracts.test_behaviors` writes it anew.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest

from colony.dsl.load import load_file
from colony.ir.expression import IsIdle
from colony.ir.program import Contract, Program
from colony.ir.types import BOOL
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import Proved, ProvedInTime, Refuted, Result
from tests.paths import BEHAVIORS, ROOT
from tests.sampling import sampled

PAGE = ROOT / "docs" / "verification.md"
_CANARY = "canary"
_HEAD = "| behavior | contracts | only while no client is late | not with operators |\n|---|---|---|---|\n"


def table_row(name: str, results: Iterable[Result]) -> str:
    """Return the row of a behavior in the table of docs/verification.md."""
    results = tuple(results)
    late = [f"`{r.contract.name}`" for r in results if isinstance(r, ProvedInTime)]
    operators = [f"`{r.contract.name}`" for r in results if isinstance(r, Proved) and not r.operators]
    return f"| `{name}` | {len(results)} | {', '.join(late)} | {', '.join(operators)} |"


def with_canary(program: Program) -> Program:
    """The program with a contract that only robots without a network keep: the first actuator is idle."""
    idle = IsIdle(type=BOOL, actuator=program.robot.actuators[0].name)
    return replace(program, contracts=(*program.contracts, Contract(name=_CANARY, expression=idle)))


@pytest.mark.parametrize("path", sampled(BEHAVIORS, every=3), ids=lambda p: p.stem)
def test_every_contract_is_proved_and_what_is_wrong_refuted(path: Path) -> None:
    program = with_canary(load_file(path))
    *results, canary = prove_contracts(program)
    assert len(results) >= 2
    assert [r.contract.name for r in results if not isinstance(r, Proved | ProvedInTime)] == []
    assert table_row(path.stem, results) in PAGE.read_text(encoding="utf-8").splitlines()
    assert isinstance(canary, Refuted if any(w.actuator for w in program.wires) else Proved)


if __name__ == "__main__":
    before, _, after = PAGE.read_text(encoding="utf-8").partition(_HEAD)
    rows = [f"{table_row(p.stem, prove_contracts(load_file(p)))}\n" for p in BEHAVIORS]
    after = re.sub(r"\A(\|.*\n)*", "", after)
    PAGE.write_text(f"{before}{_HEAD}{''.join(rows)}{after}", encoding="utf-8")
