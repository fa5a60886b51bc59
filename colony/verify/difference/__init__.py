"""Comparison of two behaviors: equal in every run, or a shortest run in which they differ."""

from colony.verify.difference.compare import difference
from colony.verify.difference.results import Different, Matching, Result, Same, Undecided

__all__ = ["Different", "Matching", "Result", "Same", "Undecided", "difference"]
