"""Pauses that grow, before something that failed is tried again."""

from __future__ import annotations

from typing import Generic, TypeVar

Span = TypeVar("Span", int, float)


class Backoff(Generic[Span]):
    """Pauses, each twice as long as the last one, in whole nanoseconds or in seconds. Mutable.

    `pause` is the next one.

    Args:
        first: the first pause.
        longest: the longest pause.
    """

    __slots__ = ("_first", "_longest", "pause")

    def __init__(self, first: Span, longest: Span) -> None:
        self._first: Span = first
        self._longest: Span = longest
        self.pause: Span = first

    def next(self) -> Span:
        """Return the next pause, and double it."""
        pause, self.pause = self.pause, min(2 * self.pause, self._longest)
        return pause

    def reset(self) -> None:
        """Begin with the first pause again."""
        self.pause = self._first
