"""Lints: warnings about correct but suspicious programs, such as modules that can never act.

A finding that says "never" is proved for every run; one that says "can" was reproduced in the reference
interpreter. A question that cannot be settled within the time limit gives no finding.
"""

from colony.verify.lints.linting import lint
from colony.verify.lints.proof import TimeBudget

__all__ = ["TimeBudget", "lint"]
