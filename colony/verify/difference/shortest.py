"""Search for a shorter run that breaks a claim than a known run."""

from __future__ import annotations

from collections.abc import Callable

from colony.ir.program import Program
from colony.verify.contracts.proof_context import ProofContext
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.results import Options, Trace
from colony.verify.contracts.search import Search
from colony.verify.contracts.solver import Budget
from colony.verify.symbolic.encode import encode


def shortest(
    program: Program, contract: str, known: Trace, options: Options, clock: Callable[[], float]
) -> Trace:
    """Return a run that breaks the contract: a shorter one than `known` if one is found in budget."""
    if len(known.snapshots) == 1:
        return known
    context, budget = ProofContext(encode(program)), Budget(options, clock)
    search = Search(context.cones[contract], context.claims[contract], budget)
    refuter = Refuter(program, contract)
    for _ in range(len(known.snapshots) - 1):
        for candidate in search.search_next_length(allow_python=False):
            trace = refuter.confirm(candidate, search)
            if trace is not None:
                return trace
            if not refuter.may_try_more(candidate):
                break
        if budget.spent():
            break
    return known
