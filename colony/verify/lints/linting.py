"""All lints of a program.

Each lint states claims as contracts. A lint that says "never" warns if its claim holds in every run: concrete
runs quickly break most claims about a program without faults, and the prover decides the rest. A lint that
says "can" warns if its claim is broken, with the run that breaks it as evidence.
"""

from __future__ import annotations

from collections.abc import Sequence

from colony.ir.expression import Expression
from colony.ir.program import Program
from colony.text.diagnostics import in_order
from colony.verify.contracts.concrete_runs import GeneratedRuns
from colony.verify.lints import contracts, fail_open, indices, limits, predicates, stuck
from colony.verify.lints.case import Case, case_of
from colony.verify.lints.driving import drives_claims
from colony.verify.lints.proof import (
    Effort,
    Finding,
    LintProver,
    asked,
    drawn_breaches,
    has_python_modules,
    with_claims,
)
from colony.verify.symbolic.system import Shape

_MAX_CANDIDATES = 12


def lint(
    program: Program, effort: Effort | None = None, shapes: dict[str, Shape] | None = None
) -> tuple[Finding, ...]:
    """Return all findings, V020 to V036, in source order.

    Findings that need more than `effort` allows are left out. `shapes` are those found for the program's
    memory by the proofs of its contracts.
    """
    effort = Effort() if effort is None else effort
    shapes = {} if shapes is None else shapes
    case = case_of(program)
    if not case.network.roots:
        return ()
    claims = dict[str, Expression]()
    for claims_of in (
        predicates.claims,
        predicates.shadows_claims,
        predicates.nodes_claims,
        contracts.claims,
    ):
        claims |= claims_of(case)
    runs = (
        None
        if has_python_modules(program)
        else GeneratedRuns(with_claims(case.instrumented, claims | dict(drives_claims(case))))
    )
    breaches = [] if runs is None else drawn_breaches(program, runs)
    refuted = frozenset[str]().union(*breaches)
    activity = _activity(case, breaches)
    prover = LintProver(case.instrumented, effort, activity, shapes)
    proved = prover.proved(asked(name, claim) for name, claim in claims.items() if name not in refuted)
    dominators = {
        m: _minimal_dominators(case, m, prover) for m in case.modules if predicates.shadowed(m) in proved
    }
    with_runs = (*limits.findings(case, prover), *indices.findings(case, effort, shapes))
    shown = {f.diagnostic: f.run for f in with_runs}
    diagnostics = in_order(
        [
            *contracts.unused_findings(case),
            *predicates.findings(case, proved),
            *predicates.shadows_findings(case, proved, dominators),
            *predicates.nodes_findings(case, proved),
            *contracts.findings(case, proved),
            *predicates.synchronized_findings(case, proved, activity, prover, runs),
            *limits.ranges_findings(case, prover),
            *fail_open.findings(case, prover, runs),
            *fail_open.held_back_findings(case, prover),
            *stuck.findings(case, prover),
            *contracts.pauses_findings(case, prover),
            *contracts.never_blind_findings(case),
            *shown,
        ]
    )
    return tuple(Finding(d, shown.get(d)) for d in diagnostics)


def _activity(case: Case, breaches: Sequence[frozenset[str]]) -> dict[str, int]:
    """Return, by module, the frames of the runs in which it is active, as a set of bits."""
    frames: dict[str, int] = dict.fromkeys(case.modules, 0)
    for number, broken in enumerate(breaches):
        for name in case.modules:
            frames[name] |= (predicates.never_active(name) in broken) << number
    return frames


def _minimal_dominators(case: Case, module: str, prover: LintProver) -> tuple[str, ...]:
    """Return a minimal set of modules that dominate a module wherever it is active."""
    dominators = case.network.dominators(module)
    if len(dominators) > _MAX_CANDIDATES or not _dominate(case, module, dominators, prover):
        return ()
    for name in reversed(dominators):
        fewer = tuple(x for x in dominators if x != name)
        if _dominate(case, module, fewer, prover):
            dominators = fewer
    return tuple(m.name for m in case.program.modules if m.name in dominators)


def _dominate(case: Case, module: str, dominators: tuple[str, ...], prover: LintProver) -> bool:
    claim = predicates.dominated(case, module, dominators)
    if claim is None:
        return False
    return bool(prover.proved([asked(f"dominated {module} {' '.join(dominators)}", claim)]))
