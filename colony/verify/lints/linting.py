"""All lints of a program.

Each lint states claims as contracts. A lint that says "never" warns if its claim holds in every run: concrete
runs quickly break most claims about a program without faults, and the prover decides the rest. A lint that
says "can" warns if its claim is broken, with the run that breaks it as evidence.
"""

from __future__ import annotations

from colony.ir.expression import Expression
from colony.ir.program import Program
from colony.text.diagnostics import in_order
from colony.verify.lints import (
    contracts,
    fail_open,
    held_back,
    indices,
    limits,
    never_blind,
    nodes,
    pauses,
    predicates,
    ranges,
    shadows,
    stuck,
    synchronized,
    unused,
)
from colony.verify.lints.case import Case, case_of
from colony.verify.lints.evidence import broken_claims
from colony.verify.lints.finding import Finding
from colony.verify.lints.proof import Effort, Prover

_MAX_CANDIDATES = 12


def lint(program: Program, effort: Effort | None = None) -> tuple[Finding, ...]:
    """Return all findings, V020 to V036, in source order.

    Findings that need more than `effort` allows are left out.
    """
    effort = Effort() if effort is None else effort
    case = case_of(program)
    if not case.network.roots:
        return ()
    to_prove, to_refute = dict[str, Expression](), dict[str, Expression]()
    for lint_module in (predicates, shadows, nodes, contracts, synchronized):
        to_prove |= lint_module.claims(case)
    for refuting_lint in (ranges, fail_open, held_back, stuck, pauses, limits):
        to_refute |= refuting_lint.claims(case)
    refuted = broken_claims(program, case.instrumented, to_prove)
    unbroken = {name: claim for name, claim in to_prove.items() if name not in refuted}
    prover = Prover(case.instrumented, unbroken | to_refute, effort)
    proved = prover.proved(unbroken)
    dominators = {
        m: _minimal_dominators(case, m, effort) for m in case.modules if shadows.shadowed(m) in proved
    }
    with_runs = (*limits.findings(case, prover), *indices.findings(case, effort))
    runs = {f.diagnostic: f.run for f in with_runs}
    diagnostics = in_order(
        [
            *unused.findings(case),
            *predicates.findings(case, proved),
            *shadows.findings(case, proved, dominators),
            *nodes.findings(case, proved),
            *contracts.findings(case, proved),
            *synchronized.findings(case, proved),
            *ranges.findings(case, prover),
            *fail_open.findings(case, prover, effort),
            *held_back.findings(case, prover, effort),
            *stuck.findings(case, prover, effort),
            *pauses.findings(case, prover),
            *never_blind.findings(case),
            *runs,
        ]
    )
    return tuple(Finding(d, runs.get(d)) for d in diagnostics)


def _minimal_dominators(case: Case, module: str, effort: Effort) -> tuple[str, ...]:
    """Return a minimal set of modules that dominate a module wherever it is active."""
    dominators = shadows.candidates(case, module)
    if len(dominators) > _MAX_CANDIDATES or not _dominate(case, module, dominators, effort):
        return ()
    for name in reversed(dominators):
        fewer = tuple(x for x in dominators if x != name)
        if _dominate(case, module, fewer, effort):
            dominators = fewer
    return tuple(m.name for m in case.program.modules if m.name in dominators)


def _dominate(case: Case, module: str, dominators: tuple[str, ...], effort: Effort) -> bool:
    claim = shadows.dominated(case, module, dominators)
    if claim is None:
        return False
    return bool(Prover(case.instrumented, {"dominated": claim}, effort).proved(["dominated"]))
