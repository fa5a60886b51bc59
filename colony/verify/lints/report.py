"""Findings of lints as lines of text."""

from __future__ import annotations

from colony.ir.expression import IsIdle
from colony.ir.program import Contract, Program
from colony.ir.types import BOOL
from colony.verify.claims import TRUE
from colony.verify.contracts.table import table
from colony.verify.lints.finding import Finding


def run_lines(program: Program, finding: Finding) -> tuple[str, ...]:
    """Return the code and the subject on one line, and the run that shows them indented below it, if any."""
    run = finding.run
    if run is None:
        return ()
    shown = TRUE if run.actuator is None else IsIdle(type=BOOL, actuator=run.actuator)
    about = Contract(name=run.subject, expression=shown)
    rows = table(program, about, run.trace)
    return (f"{finding.diagnostic.code:8} {run.subject}", *(f"  {row}" for row in rows))
