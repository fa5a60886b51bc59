"""Lint of two modules of one actuator that are always active at the same time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from functools import partial
from itertools import combinations

from colony.ir.expression import Binary
from colony.ir.program import Module
from colony.text.diagnostics import Diagnostic, warning
from colony.verify.claims import active, binary
from colony.verify.contracts.concrete_runs import GeneratedRuns
from colony.verify.lints.case import Case
from colony.verify.lints.predicates import always_active, never_active
from colony.verify.lints.proof import Prover, Question
from colony.verify.lints.shadows import shadowed


def findings(
    case: Case, proved: Set[str], activity: Mapping[str, int], prover: Prover, runs: GeneratedRuns | None
) -> Iterator[Diagnostic]:
    """Yield the warnings about modules that are always active together.

    Modules with different `activity` in runs are not, and modules with another finding need no question. A
    frame that separates two modules often separates others, too.
    """
    seen = dict(activity)
    groups: dict[tuple[str | None, int], list[Module]] = {}
    for m in case.own_modules.values():
        other_findings = {claim(m.name) for claim in (never_active, always_active, shadowed)}
        if m.command is not None and case.has_inputs(m) and not other_findings & proved:
            groups.setdefault((m.actuator, seen[m.name]), []).append(m)
    for a, b in (pair for group in groups.values() for pair in combinations(group, 2)):
        if seen[a.name] != seen[b.name]:
            continue
        together = partial(binary, Binary.EQUAL, active(a.name), active(b.name))
        question = Question(f"together {a.name} {b.name}", together)
        is_proved = bool(prover.proved([question]))
        frame = prover.broken_start(question.name)
        for outcome in runs.outcomes([frame]) if runs is not None and frame is not None else ():
            seen = {m: x << 1 | (never_active(m) in outcome.breaches) for m, x in seen.items()}
        if is_proved:
            yield warning(
                "V029",
                b.span,
                f"`{a.name}` and `{b.name}` are always active together, and both command `{a.actuator}`",
                "merge them into one module, or make their predicates differ",
            )
