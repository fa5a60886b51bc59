"""Comparison of two behaviors: equal in every run, or a shortest run in which they differ."""

from colony.verify.difference.compare import difference
from colony.verify.difference.results import DifferenceUndecided, Different, Matching, Result, Same

__all__ = ["DifferenceUndecided", "Different", "Matching", "Result", "Same", "difference"]
