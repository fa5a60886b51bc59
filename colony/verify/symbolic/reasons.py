"""Reasons for inexactness: why a formula differs from what the program computes bit for bit."""

from __future__ import annotations

from collections.abc import Iterable

import z3

from colony.verify.symbolic.cones import cone
from colony.verify.symbolic.system import Claim, Inexact, Reason, System


def reasons_of(system: System, *terms: z3.ExprRef) -> tuple[Reason, ...]:
    """Return the reasons of all inexact terms that `terms` depend on over all frames, each once.

    Comparisons, choices, minimum and maximum, negation, constants and copies are exact.
    """
    if not system.inexact:
        return ()
    visited = cone(system, terms).visited
    found = {inexact_term.reason: None for key, inexact_term in system.inexact.items() if key in visited}
    return tuple(found)


def rounding_reasons(claims: Iterable[Claim]) -> tuple[Reason, ...]:
    """Return the places where reals stand in for floats in a contract or in the lemmas of its proof."""
    reasons = dict.fromkeys(r for claim in claims for r in claim.inexact)
    return tuple(r for r in reasons if r.kind is Inexact.ROUNDING)
