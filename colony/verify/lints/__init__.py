"""What is odd in a program that is no error: modules that can never act, conditions that never change, ...

What a lint says "never" of is proved for every run; what it says "can" of was seen in the reference
interpreter. Where neither can be done in the time that there is, nothing is said.
"""

from colony.verify.lints.linting import lint
from colony.verify.lints.proof import Patience

__all__ = ["Patience", "lint"]
