"""A search for a shorter run than one that is known to break a claim."""

from __future__ import annotations

from collections.abc import Callable

from colony.ir.program import Program
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.results import Options, Trace
from colony.verify.contracts.search import Search
from colony.verify.contracts.setting import Setting
from colony.verify.contracts.solver import Budget
from colony.verify.symbolic.encode import encode


def shortest(
    program: Program, contract: str, known: Trace, options: Options, clock: Callable[[], float]
) -> Trace:
    """Return a run that breaks the contract with no more frames than `known`, which breaks it.

    It has fewer if the search finds such a run within its budget.
    """
    if len(known.snapshots) == 1:
        return known
    setting, budget = Setting(encode(program)), Budget(options, clock)
    search = Search(setting.cones[contract], setting.claims[contract], budget)
    refuter = Refuter(program, contract)
    for _ in range(len(known.snapshots) - 1):
        for candidate in search.longer(asked=False):
            trace = refuter.believe(candidate, search)
            if trace is not None:
                return trace
            if not refuter.patient(candidate):
                break
        if budget.spent():
            break
    return known
