"""Small choices, on which the strategies are built."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random
from typing import TypeVar

T = TypeVar("T")


class Choices:
    """Choices from a source of random numbers: a real one, or one of hypothesis, which then shrinks them.

    Each is made so that it shrinks to the first, the fewest, or no. They are drawn from one `randoms()`, not
    by a strategy each: those cost more, and hypothesis repeats parts drawn by equal strategies, which makes
    five of six drawn programs nearly the same.
    """

    def __init__(self, random: Random) -> None:
        self._random = random

    def upto(self, most: int) -> int:
        """Choose a number from 0 to `most`."""
        return self._random.randint(0, most) if most > 0 else 0

    def between(self, fewest: int, most: int) -> int:
        """Return a number between two ends, both included."""
        return fewest + self.upto(most - fewest)

    def several(self, fewest: int, most: int) -> int:
        """Choose a number from `fewest` to `most`, rather a large one."""
        return fewest + max(self.upto(most - fewest), self.upto(most - fewest))

    def one(self, of: Sequence[T]) -> T:
        """Choose one of the options, of which there is at least one."""
        return of[self.upto(len(of) - 1)]

    def rarely(self, times: int = 3) -> bool:
        """Choose True about once in `times`."""
        return self.upto(times - 1) == times - 1
