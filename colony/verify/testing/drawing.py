"""The random choices on which all strategies are built."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random
from typing import TypeVar

T = TypeVar("T")


class Choices:
    """Choices from a source of random numbers: `random`, or one from hypothesis, which can shrink them.

    A choice shrinks to the first option, the smallest number, or False. All choices come from one
    `randoms()` rather than each from its own strategy: many strategies cost more, and hypothesis repeats the
    draws of equal strategies, which makes five of six drawn programs nearly the same.
    """

    def __init__(self, random: Random) -> None:
        self._random = random

    def up_to(self, high: int) -> int:
        """Choose a number from 0 to `high`."""
        return self._random.randint(0, high) if high > 0 else 0

    def between(self, low: int, high: int) -> int:
        """Choose a number from `low` to `high`."""
        return low + self.up_to(high - low)

    def mostly_large(self, low: int, high: int) -> int:
        """Choose a number from `low` to `high`, more often a large one."""
        return low + max(self.up_to(high - low), self.up_to(high - low))

    def pick(self, options: Sequence[T]) -> T:
        """Choose one of the options, which must not be empty."""
        return options[self.up_to(len(options) - 1)]

    def one_in(self, times: int) -> bool:
        """Choose True about once in `times` calls."""
        return self.up_to(times - 1) == times - 1
