"""Texts that change while they are edited: positions in UTF-16, words, and where an old offset is now."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from msgspec import Struct

_LINE_BREAK = re.compile(r"\r\n|\r|\n")


class TextPosition(Struct, frozen=True, gc=False):
    """A line, and a character of it in UTF-16 code units, both from 0."""

    line: int
    character: int


class TextRange(Struct, frozen=True, gc=False):
    """The characters from `start` up to, and not including, `end`."""

    start: TextPosition
    end: TextPosition


def units(text: str) -> int:
    """Return the length of a text in UTF-16 code units."""
    return len(text) if text.isascii() else len(text.encode("utf-16-le", "surrogatepass")) // 2


class Lines:
    """A text with its lines."""

    def __init__(self, text: str) -> None:
        self.text = text

    @cached_property
    def starts(self) -> list[int]:
        """The offsets at which lines begin."""
        return [0, *(match.end() for match in _LINE_BREAK.finditer(self.text))]

    def position(self, offset: int) -> TextPosition:
        """Return the position of an offset; one outside of the text counts as its nearest end."""
        offset = min(max(offset, 0), len(self.text))
        line = bisect_right(self.starts, offset) - 1
        before = self.text[self.starts[line] : offset]
        return TextPosition(line, units(before))

    def offset(self, position: TextPosition) -> int:
        """Return the offset of a position; one outside of its line counts as the line's end."""
        if position.line >= len(self.starts):
            return len(self.text)
        start = self.starts[max(position.line, 0)]
        match = _LINE_BREAK.search(self.text, start)
        line = self.text[start : len(self.text) if match is None else match.start()]
        if line.isascii():
            return start + min(max(position.character, 0), len(line))
        before = line.encode("utf-16-le", "surrogatepass")[: 2 * max(position.character, 0)]
        return start + len(before.decode("utf-16-le", errors="ignore"))

    def range(self, start: int, end: int) -> TextRange:
        """Return the range of two offsets."""
        return TextRange(self.position(start), self.position(end))


@dataclass(slots=True)
class Drift:
    """What changed of a text since it was analyzed: `start` up to `then` became `start` up to `now`. Mutable.

    All changes count as one, from the first changed character to the last.
    """

    start: int = -1
    then: int = -1
    now: int = -1

    def change(self, start: int, end: int, length: int) -> None:
        """Count a change of the present text: `length` characters in place of `start` up to `end`."""
        if self.start < 0:
            self.start, self.then, self.now = start, end, start + length
            return
        last = max(self.now, end)
        self.start = min(self.start, start)
        self.then += last - self.now
        self.now = last + length - (end - start)

    def to_now(self, offset: int) -> int | None:
        """Return where a character of the analyzed text is now; None if it was changed."""
        if self.start < 0 or offset <= self.start:
            return offset
        return offset + self.now - self.then if offset >= self.then else None

    def to_then(self, offset: int) -> int | None:
        """Return where a character was in the analyzed text; None if it is new."""
        if self.start < 0 or offset <= self.start:
            return offset
        return offset + self.then - self.now if offset >= self.now else None

    @classmethod
    def between(cls, then: str, now: str) -> Drift:
        """Return what changed from one text to another."""
        if then == now:
            return cls()
        low, high = 0, min(len(then), len(now))
        while low < high:
            middle = (low + high + 1) // 2
            low, high = (middle, high) if then[low:middle] == now[low:middle] else (low, middle - 1)
        start = low
        low, high = 0, min(len(then), len(now)) - start
        while low < high:
            middle = (low + high + 1) // 2
            same = then[len(then) - middle : len(then) - low] == now[len(now) - middle : len(now) - low]
            low, high = (middle, high) if same else (low, middle - 1)
        return cls(start, len(then) - low, len(now) - low)


# --- words ----------------------------------------------------------------------------------------------

_TOKEN = re.compile(
    r"(?P<comment>#[^\r\n]*)|(?P<string>\"[^\"\r\n]*\"?)|(?P<number>[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<word>[A-Za-z_][A-Za-z0-9_]*)|(?P<sign>->|\.\.|[<>=!]=|[^\s\w])"
)

KEYWORDS = frozenset(
    "actuator active ago and any as assume at bearing by commanded commands contract default degrade do "
    "else enum every expect failsafe false for frame from given idle if implies import in inhibits input is "
    "jitter keep language let limit machine missing module network next not on_loss or param python range "
    "rate reach reads requirement restart robot sensor sequence start state step stop suppresses taken test "
    "then time to true tunable until when within".split()
)
"""The words of the language; most are keywords only where they can stand."""


class Lexeme(NamedTuple):
    """A piece of text: a comment, a string, a number, a word or a sign."""

    kind: str
    text: str
    start: int

    @property
    def end(self) -> int:
        """The offset at which it ends."""
        return self.start + len(self.text)


def lexemes(text: str, start: int = 0, end: int | None = None) -> Iterator[Lexeme]:
    """Yield the pieces of a text, without blanks; whatever the text is."""
    for match in _TOKEN.finditer(text, start, len(text) if end is None else end):
        yield Lexeme(str(match.lastgroup), match[0], match.start())


_DECLARATION = re.compile(
    r"^(?:language|robot|enum|import|input|tunable|param|let|state|next|machine|sequence|failsafe|module|network"
    r"|limit|contract|reach|assume|test)\b",
    re.MULTILINE,
)


def declaration_start(text: str, offset: int) -> int:
    """Return the offset of the line at the left margin that begins the declaration around an offset."""
    found = 0
    line_end = text.find("\n", offset)
    for match in _DECLARATION.finditer(text, 0, len(text) if line_end < 0 else line_end):
        if match.start() > offset:
            break
        found = match.start()
    return found
