"""Reasons for inexactness: why a formula in a cone is not bit for bit what the program computes."""

from __future__ import annotations

import z3

from colony.verify.symbolic.cones import cone
from colony.verify.symbolic.system import Reason, System


def reasons_of(system: System, *terms: z3.ExprRef) -> tuple[Reason, ...]:
    """Return all inexact terms that `terms` depend on, over all frames; each reason once.

    Comparisons, choices, least and greatest, negation, constants, and whatever is only copied are exact.
    """
    met = cone(system, terms).visited
    found = {blamed.reason: None for key, blamed in system.inexact.items() if key in met}
    return tuple(found)
