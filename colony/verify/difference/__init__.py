"""Whether two behaviors are the same: equal in every run, or a shortest run that tells them apart."""

from colony.verify.difference.compare import difference
from colony.verify.difference.results import Different, Matching, Result, Same, Undecided

__all__ = ["Different", "Matching", "Result", "Same", "Undecided", "difference"]
