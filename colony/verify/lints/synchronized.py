"""Lint of two modules of one actuator that are always active at the same time."""

from __future__ import annotations

from collections.abc import Iterator, Set
from itertools import combinations

from colony.ir.expression import Binary, Expression
from colony.ir.program import Module
from colony.text.diagnostics import Diagnostic, warning
from colony.verify.claims import active, binary
from colony.verify.lints.case import Case
from colony.verify.lints.predicates import always_active, never_active
from colony.verify.lints.shadows import shadowed


def _name(a: Module, b: Module) -> str:
    return f"together {a.name} {b.name}"


def _pairs(case: Case) -> Iterator[tuple[Module, Module]]:
    own = [m for m in case.own_modules.values() if m.command is not None and case.has_inputs(m)]
    for a, b in combinations(own, 2):
        if a.actuator == b.actuator:
            yield a, b


def claims(case: Case) -> Iterator[tuple[str, Expression]]:
    """Yield the claims that two modules are always active together."""
    for a, b in _pairs(case):
        yield _name(a, b), binary(Binary.EQUAL, active(a.name), active(b.name))


def findings(case: Case, proved: Set[str]) -> Iterator[Diagnostic]:
    """Yield the warnings about modules that are always active together."""
    for a, b in _pairs(case):
        other_findings = {claim(m.name) for m in (a, b) for claim in (never_active, always_active, shadowed)}
        if _name(a, b) in proved and not other_findings & proved:
            yield warning(
                "V029",
                b.span,
                f"`{a.name}` and `{b.name}` are always active together, and both command `{a.actuator}`",
                "merge them into one module, or make their predicates differ",
            )
