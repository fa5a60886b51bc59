"""Lint of predicates that never hold, or always hold, whatever the sensors read."""

from __future__ import annotations

from collections.abc import Iterator, Set

from colony.ir.expression import Expression
from colony.text.diagnostics import Diagnostic, warning
from colony.verify.claims import active, all_of, fresh, implies, negation
from colony.verify.lints.case import Case
from colony.verify.source_text import source_text


def never_active(module: str) -> str:
    """Return the name of the claim that a module is never active."""
    return f"never {module}"


def always_active(module: str) -> str:
    """Return the name of the claim that a module is always active."""
    return f"always {module}"


def claims(case: Case) -> Iterator[tuple[str, Expression]]:
    """Yield the claims that a module is never active and, if its predicate reads anything, always active."""
    for name, module in case.modules.items():
        yield never_active(name), negation(active(name))
        if case.is_own(module.span) and case.has_inputs(module):
            all_present = all_of(fresh(s) for s in sorted(case.contents.needs(module)))
            yield always_active(name), implies(all_present, active(name))


def findings(case: Case, proved: Set[str]) -> Iterator[Diagnostic]:
    """Yield the warnings about constant predicates."""
    for name, module in case.own_modules.items():
        if not case.has_inputs(module):
            continue
        predicate = source_text(module.when)
        if never_active(name) in proved:
            yield warning(
                "V021",
                module.when.span,
                f"`{name}` is never active: its predicate `{predicate}` is false whatever the sensors read",
                "correct the predicate: compare it with the ranges of the sensors that it reads",
            )
        elif always_active(name) in proved:
            needed = sorted(case.contents.needs(module))
            while_ = f" while {', '.join(f'`{s}`' for s in needed)} is present" if len(needed) == 1 else ""
            while_ = while_ or (" while everything that it reads is present" if needed else "")
            yield warning(
                "V022",
                module.when.span,
                f"`{name}` is always active{while_}: its predicate `{predicate}` is true whatever the "
                "sensors read",
                "write `when true` if that is intended; otherwise correct the predicate",
            )
