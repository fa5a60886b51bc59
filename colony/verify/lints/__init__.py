"""Lints: findings that are no errors, as modules that can never act and conditions that never change.

A lint's "never" is proved for every run; its "can" was seen in the reference interpreter. If neither is
possible within the time limit, there is no finding.
"""

from colony.verify.lints.linting import lint
from colony.verify.lints.proof import Patience

__all__ = ["Patience", "lint"]
