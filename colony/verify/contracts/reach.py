"""What a `reach` declares: some run gets to a frame in which its condition is true, every client in time.

It is proved as the contract that no run does (`check_contract` makes it): what refutes that contract is the
run that was asked for, and a proof of it is a finding.
"""

from __future__ import annotations

from dataclasses import replace

from colony.dsl import ast
from colony.dsl.parse import parse
from colony.ir.expression import MemoryCall, subexpressions
from colony.ir.program import Contract, Program
from colony.text.diagnostics import Diagnostic, error
from colony.text.wording import counted
from colony.verify.contracts.results import Result, Trace

VERDICTS = {"proved": "NEVER REACHED", "proved in time": "NEVER REACHED", "REFUTED": "reached"}
"""Verdicts of a reach, by those of the contract by which it is proved, where they differ."""

_NEVER_HINT = "declare a `reach` for each of its parts, to see which of them no run gets to"


def with_reaches(program: Program) -> Program:
    """Return the program with the contracts of its reaches after its own, by which they are proved."""
    return replace(program, contracts=(*program.contracts, *program.reaches), reaches=())


def length_text(trace: Trace) -> str:
    """Return the length of the run that reaches something."""
    return f"(in {counted(len(trace.snapshots), 'frame')})"


def never_reached(result: Result) -> Diagnostic:
    """Return the error for a reach that no run gets to."""
    message = f"no run reaches `{result.contract.name}`, whatever sensors read while every client is in time"
    return error("V015", result.contract.span, message, _NEVER_HINT)


def expectation(program: Program, reach: Contract) -> ast.Expression | None:
    """Return what a test in the main file expects in the frame that a run reaches.

    None if it cannot: a reach of another file has names of that file, and the memory of an expectation knows
    nothing of the steps before its own.
    """
    main = program.files[-1][1] if program.files else None
    if reach.span.source is not main or any(
        isinstance(x, MemoryCall) for x in subexpressions(reach.expression)
    ):
        return None
    found = (d for d in parse(reach.span.source).file.declarations if isinstance(d, ast.ContractDecl))
    return next((d.expression for d in found if d.name.start == reach.span.start), None)
