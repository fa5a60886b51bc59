"""Search for a run that breaks a claim and is shorter than a known one."""

from __future__ import annotations

from colony.ir.program import Program
from colony.verify.contracts.proof_context import ProofContext
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.results import Options, Trace
from colony.verify.contracts.search import Search, called_modules
from colony.verify.contracts.solver import Budget
from colony.verify.symbolic.encode import encode


def shortest_trace(program: Program, contract: str, known_trace: Trace, options: Options) -> Trace:
    """Return a run that breaks the contract: a shorter one than `known_trace` if one is found in budget."""
    if len(known_trace.snapshots) == 1:
        return known_trace
    context, budget = ProofContext(encode(program)), Budget(options)
    search = Search(context.cones[contract], context.claims[contract], budget)
    refuter = Refuter(program, contract, called_modules(context.cones[contract]))
    for _ in range(len(known_trace.snapshots) - 1):
        for candidate in search.search_next_length(allow_python=False):
            trace = refuter.confirm(candidate, search)
            if trace is not None:
                return trace
            if not refuter.may_try_more(candidate):
                break
        if budget.is_spent():
            break
    return known_trace
