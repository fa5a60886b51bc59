"""The random choices of which all strategies are built."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random
from typing import TypeVar

T = TypeVar("T")


class Choices:
    """Choices from a source of random numbers: `random`, or one of hypothesis, which can shrink them.

    A choice shrinks to the first option, the smallest number, or False. All choices are drawn from one
    `randoms()` rather than each by a strategy of its own: those cost more, and hypothesis repeats what equal
    strategies drew, which makes five of six drawn programs nearly the same.
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
        """Choose a number from `fewest` to `most`, more often a large one."""
        return fewest + max(self.upto(most - fewest), self.upto(most - fewest))

    def one(self, of: Sequence[T]) -> T:
        """Choose one of the options, of which there is at least one."""
        return of[self.upto(len(of) - 1)]

    def rarely(self, times: int = 3) -> bool:
        """Choose True about once in `times`."""
        return self.upto(times - 1) == times - 1
