"""Lints: warnings about correct but suspicious programs, such as modules that can never act.

A finding that says "never" is proved for every run; one that says "can" was reproduced in the reference
interpreter. A question that cannot be settled within the effort allowed gives no finding.
"""

from colony.verify.lints.linting import lint
from colony.verify.lints.proof import Effort

__all__ = ["Effort", "lint"]
