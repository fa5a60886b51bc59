"""All lints of a program.

Each lint makes claims: contracts that hold always if and only if something is odd. Concrete runs break most
of the claims about a sound program in no time; what is left is for the prover. A lint that says "can" wants
its claim broken, and the run that breaks it is the evidence.
"""

from __future__ import annotations

from colony.ir.expression import Expression
from colony.ir.program import Program
from colony.text.diagnostics import Diagnostic, in_order
from colony.verify.lints import (
    contracts,
    fail_open,
    nodes,
    pauses,
    predicates,
    ranges,
    shadows,
    twins,
    unused,
)
from colony.verify.lints.case import Case, case_of
from colony.verify.lints.evidence import broken
from colony.verify.lints.proof import Patience, Prover

_MOST_NAMED = 12


def lint(program: Program, patience: Patience | None = None) -> tuple[Diagnostic, ...]:
    """Return all findings as warnings V020 to V031, in the order of the text.

    Findings that need more time than `patience` allows are left out.
    """
    patience = Patience() if patience is None else patience
    case = case_of(program)
    if not case.network.roots:
        return ()
    never, can = dict[str, Expression](), dict[str, Expression]()
    for source in (predicates, shadows, nodes, contracts, twins):
        never |= source.claims(case)
    for broken_source in (ranges, fail_open, pauses):
        can |= broken_source.claims(case)
    seen = broken(program, case.observed, never)
    left = {name: claim for name, claim in never.items() if name not in seen}
    prover = Prover(case.observed, left | can, patience)
    proved = prover.proved(left)
    by = {m: _least(case, m, patience) for m in case.modules if shadows.shadowed(m) in proved}
    return in_order(
        [
            *unused.told(case),
            *predicates.told(case, proved),
            *shadows.told(case, proved, by),
            *nodes.told(case, proved),
            *contracts.told(case, proved),
            *twins.told(case, proved),
            *ranges.told(case, prover),
            *fail_open.told(case, prover),
            *pauses.told(case, prover),
        ]
    )


def _least(case: Case, module: str, patience: Patience) -> tuple[str, ...]:
    """Return a minimal set of modules that dominate a module wherever it is active."""
    who = shadows.candidates(case, module)
    if len(who) > _MOST_NAMED or not _dominate(case, module, who, patience):
        return ()
    for name in reversed(who):
        fewer = tuple(x for x in who if x != name)
        if _dominate(case, module, fewer, patience):
            who = fewer
    return tuple(m.name for m in case.program.modules if m.name in who)


def _dominate(case: Case, module: str, who: tuple[str, ...], patience: Patience) -> bool:
    claim = shadows.dominated(case, module, who)
    if claim is None:
        return False
    return bool(Prover(case.observed, {"dominated": claim}, patience).proved(["dominated"]))
