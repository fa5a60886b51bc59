"""Source texts and spans of them.

A `Span` is a half-open range of character offsets in one `Source`; lines and columns are computed only
when a position is shown to a person.
"""

from __future__ import annotations

from bisect import bisect_right
from functools import cached_property
from typing import NamedTuple


class Source:
    """A text with its name in messages (usually the path as the user typed it)."""

    def __init__(self, name: str, text: str) -> None:
        self.name = name
        self.text = text

    @cached_property
    def _line_starts(self) -> list[int]:
        starts = [0]
        find = self.text.find
        newline = find("\n")
        while newline >= 0:
            starts.append(newline + 1)
            newline = find("\n", newline + 1)
        return starts

    def position(self, offset: int) -> tuple[int, int]:
        """Return the 1-based line and column of a character offset (one past the end is allowed)."""
        offset = min(max(offset, 0), len(self.text))
        line = bisect_right(self._line_starts, offset)
        return line, offset - self._line_starts[line - 1] + 1

    def line(self, number: int) -> str:
        """Return the text of 1-based line `number`, without its line break."""
        start = self._line_starts[number - 1]
        end = self.text.find("\n", start)
        return self.text[start : end if end >= 0 else len(self.text)].rstrip("\r")

    def __repr__(self) -> str:
        """Return the class and the file name."""
        return f"Source({self.name!r})"


class Span(NamedTuple):
    """The characters from `start` up to, and not including, `end` of `source`."""

    source: Source
    start: int
    end: int

    def to(self, other: Span) -> Span:
        """Return the span from the start of this one to the end of `other`."""
        return Span(self.source, self.start, max(self.end, other.end))

    @property
    def text(self) -> str:
        """Return the text within the span."""
        return self.source.text[self.start : self.end]

    @property
    def place(self) -> str:
        """The start of the span as `file:line:column`."""
        line, column = self.source.position(self.start)
        return f"{self.source.name}:{line}:{column}"

    def __repr__(self) -> str:
        """Return the place of the span."""
        return self.place


NOWHERE = Span(Source("<none>", ""), 0, 0)
"""The span of elements without a source text, such as those of programs built in memory."""
