"""All contracts of the shipped behaviors are proved, those of imported files among them.

docs/verification.md has a table of those that are only proved in time or over reals, or without operators:
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
from colony.verify.contracts.results import OverReals, Proved, ProvedInTime, Refuted, Result
from tests.paths import BEHAVIORS, ROOT
from tests.sampling import sampled

PAGE = ROOT / "docs" / "verification.md"
_CANARY = "canary"
_HEAD = """\
| behavior | contracts | only in time | only over reals | proved without operators |
|---|---|---|---|---|
"""


def table_rows(name: str, results: Iterable[Result]) -> list[str]:
    """Return the row of a behavior in the table of docs/verification.md; none if all holds with operators."""
    results = tuple(results)
    late = [f"`{r.contract.name}`" for r in results if isinstance(r, ProvedInTime)]
    reals = [f"`{r.contract.name}`" for r in results if isinstance(r, OverReals)]
    operators = [f"`{r.contract.name}`" for r in results if isinstance(r, Proved) and not r.operators]
    if not late and not reals and not operators:
        return []
    cells = " | ".join(", ".join(names) for names in (late, reals, operators))
    return [f"| `{name}` | {len(results)} | {cells} |"]


def with_canary(program: Program) -> Program:
    """The program with a contract that only robots without a network keep: the first actuator is idle."""
    idle = IsIdle(type=BOOL, actuator=program.robot.actuators[0].name)
    return replace(program, contracts=(*program.contracts, Contract(name=_CANARY, expression=idle)))


@pytest.mark.parametrize("path", sampled(BEHAVIORS, every=3, thorough=True), ids=lambda p: p.stem)
def test_every_contract_is_proved_and_what_is_wrong_refuted(path: Path) -> None:
    program = with_canary(load_file(path))
    *results, canary = prove_contracts(program)
    assert len(results) >= 2
    assert [r.contract.name for r in results if not isinstance(r, Proved | ProvedInTime | OverReals)] == []
    rows = PAGE.read_text(encoding="utf-8").partition(_HEAD)[2].partition("\n\n")[0].splitlines()
    assert [row for row in rows if row.startswith(f"| `{path.stem}` |")] == table_rows(path.stem, results)
    assert isinstance(canary, Refuted if any(w.actuator for w in program.wires) else Proved)


if __name__ == "__main__":
    before, _, after = PAGE.read_text(encoding="utf-8").partition(_HEAD)
    rows = [f"{row}\n" for p in BEHAVIORS for row in table_rows(p.stem, prove_contracts(load_file(p)))]
    after = re.sub(r"\A(\|.*\n)*", "", after)
    PAGE.write_text(f"{before}{_HEAD}{''.join(rows)}{after}", encoding="utf-8")
