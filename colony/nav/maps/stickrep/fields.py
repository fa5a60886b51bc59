"""The words of a StickRep line, and the readers of single fields: numbers in ranges, names, kinds.

Each reader returns its value or, after reporting an error, None.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import NamedTuple

from colony.nav.maps.stickrep.model import EdgeKind
from colony.text.diagnostics import Diagnostic, error
from colony.text.source import Source, Span
from colony.text.units import BASE_UNITS, LENGTH

LENGTH_UNITS = {
    name: float(factor) for name, (dimension, factor) in BASE_UNITS.items() if dimension == LENGTH
}
"""Units of length by name, in mm."""

MAX_PROBLEMS = 200
MAX_LENGTH_MM = 1e6
MIN_LENGTH_MM = 1.0
MAX_COORDINATE_MM = 1e8
MAX_LIGHTS = 100

_WORD = re.compile(r"\S+")
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?", re.ASCII)
_NUMBER_LIKE = re.compile(r"[-+.0-9]", re.ASCII)
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.'-]{0,63}", re.ASCII)


class TooManyProblemsError(Exception):
    """A map has too many problems; reading stops."""


class Problems(list[Diagnostic]):
    """The errors found so far."""

    def report(self, code: str, span: Span, message: str, hint: str | None = None) -> None:
        """Add an error.

        Raises:
            TooManyProblemsError: the maximum number of problems is reached.
        """
        self.append(error(code, span, message, hint))
        if len(self) >= MAX_PROBLEMS:
            hint = "fix the first errors: the others may follow from them"
            self.append(error("M023", span, f"stopped after {MAX_PROBLEMS} errors", hint))
            raise TooManyProblemsError


class LineWord(NamedTuple):
    """A word of a line, and its span."""

    text: str
    span: Span

    @property
    def shown(self) -> str:
        """The word as quoted in messages, shortened."""
        text = self.text if len(self.text) <= 40 else self.text[:37] + "..."
        return f"`{text}`"

    @property
    def looks_like_number(self) -> bool:
        """True if the word was probably meant as a number; rows begin with a number, header lines do not."""
        return _NUMBER_LIKE.match(self.text) is not None


def lines_of_words(source: Source) -> Iterator[list[LineWord]]:
    """Return the words of each nonempty line, without comments."""
    start = 0
    while start < len(source.text):
        end = source.text.find("\n", start)
        end = len(source.text) if end < 0 else end
        comment = source.text.find("#", start, end)
        stop = end if comment < 0 else comment
        words = [
            LineWord(m.group(), Span(source, m.start(), m.end()))
            for m in _WORD.finditer(source.text, start, stop)
        ]
        if words:
            yield words
        start = end + 1


def line_end(words: list[LineWord]) -> Span:
    """Return the empty span at the end of a line's last word."""
    last = words[-1].span
    return Span(last.source, last.end, last.end)


def values(problems: Problems, words: list[LineWord], usage: str) -> list[LineWord] | None:
    """Return the words after the first one; None, with an error, if their number is not that in `usage`."""
    expected = len(usage.split())
    if len(words) == expected:
        return words[1:]
    place = line_end(words) if len(words) < expected else words[expected].span
    message = f"expected `{usage}`; found {len(words) - 1} value{'s' if len(words) != 2 else ''}"
    problems.report("M007", place, message)
    return None


def number(problems: Problems, word: LineWord, what: str) -> float | None:
    """Read a finite decimal number."""
    if _NUMBER.fullmatch(word.text) is None:
        problems.report("M009", word.span, f"expected {what}, a number; found {word.shown}")
        return None
    value = float(word.text)
    if not math.isfinite(value):
        problems.report("M009", word.span, f"{word.shown} is too large for {what}")
        return None
    return value


def number_in_range(
    problems: Problems, word: LineWord, what: str, low: float, high: float, unit: str
) -> float | None:
    """Read a number whose magnitude is from `low` to `high`."""
    value = number(problems, word, what)
    if value is not None and not low <= abs(value) <= high:
        expected = f"up to {high:,.0f} {unit}" if low == 0 else f"from {low:.2g} to {high:,.0f} {unit}"
        problems.report(
            "M009", word.span, f"{what} is {word.shown}; expected a magnitude {expected}", _range_hint(what)
        )
        return None
    return value


def length_mm(
    problems: Problems, word: LineWord, what: str, low_mm: float, high_mm: float, unit: str
) -> float | None:
    """Read a length in `unit`, with a magnitude in a range given in mm."""
    scale = LENGTH_UNITS[unit]
    value = number_in_range(problems, word, what, low_mm / scale, high_mm / scale, unit)
    return None if value is None else value * scale


def _range_hint(what: str) -> str | None:
    return "two neighboring nodes are at different places" if what == "the length" else None


def whole_number(problems: Problems, word: LineWord, what: str, high: int) -> int | None:
    """Read a whole number from 0 to `high`."""
    if not (word.text.isascii() and word.text.isdigit()):
        problems.report("M009", word.span, f"expected {what}, a whole number; found {word.shown}")
        return None
    value = int(word.text[:10])
    if value > high:
        problems.report("M009", word.span, f"{what} is {word.shown}; expected at most {high}")
        return None
    return value


def name(problems: Problems, word: LineWord, what: str) -> str | None:
    """Read a name: letters, digits and `_.'-`, at most 64 of them."""
    if _NAME.fullmatch(word.text) is None:
        hint = "a name is a letter, digit or _, followed by up to 63 letters, digits, _ . ' or -"
        problems.report("M008", word.span, f"expected {what}; {word.shown} is not a name", hint)
        return None
    return word.text


def edge_kind(problems: Problems, word: LineWord) -> EdgeKind | None:
    """Read the kind of an edge: W, D or E."""
    for kind in EdgeKind:
        if word.text == kind.value:
            return kind
    hint = f"write {word.text.upper()}" if word.text in ("w", "d", "e") else None
    message = f"expected an edge type, W (wall), D (door) or E (elevator); found {word.shown}"
    problems.report("M011", word.span, message, hint)
    return None
