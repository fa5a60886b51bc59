"""Small choices, on which the strategies are built."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from hypothesis import strategies as st

T = TypeVar("T")


class Choices:
    """Draws of a composite strategy. Each is made so that it shrinks to the first, the fewest, or no."""

    def __init__(self, draw: st.DrawFn) -> None:
        self._draw = draw

    def upto(self, most: int) -> int:
        """0 .. `most`."""
        return self._draw(st.integers(0, most)) if most > 0 else 0

    def between(self, fewest: int, most: int) -> int:
        return fewest + self.upto(most - fewest)

    def one(self, of: Sequence[T]) -> T:
        """One of at least one."""
        return of[self.upto(len(of) - 1)]

    def rarely(self, times: int = 3) -> bool:
        """Yes about once in `times`."""
        return self.upto(times - 1) == times - 1
