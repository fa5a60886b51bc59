"""TOML texts within limits, and the places of their keys and values, which `tomllib` does not report.

The places are those of a text that `tomllib` has read, so that this scanner need not find its errors. What it
does not understand, it leaves out.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Generator, Iterator
from typing import NamedTuple

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_KEY = re.compile(r"""[A-Za-z0-9_-]+|"(?:[^"\\\n]|\\.)*"|'[^'\n]*'""")
_TEXT = re.compile(
    r'''"""(?:\\.|[^\\])*?"""(?:"{0,2})|\'\'\'.*?\'\'\'(?:'{0,2})|"(?:[^"\\\n]|\\.)*"|'[^'\n]*\'''',
    re.DOTALL,
)
_SCALAR = re.compile(r"[^,#\[\]{}\r\n]+")

Path = tuple[str, ...]

MAX_DOTS = 100
"""Maximum number of dots in a key: `tomllib` takes minutes for one of many thousand parts."""


def tables_of(text: str) -> dict[str, object]:
    """Return the tables of a TOML text.

    Raises:
        ValueError: it is not TOML, nests too deep, or has a key with too many parts.
    """
    if any(run.count(".") > MAX_DOTS for run in re.findall(r"""[\w"' \t.-]+""", text)):
        raise ValueError(f"a key has more than {MAX_DOTS} dots")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("it nests too deep") from None


class Extent(NamedTuple):
    """The characters from `start` up to, and not including, `end`."""

    start: int
    end: int


class KeyPlace(NamedTuple):
    """The place of a key with all its parts, and that of its value; a table's value is its key."""

    key: Extent
    value: Extent
    is_table: bool = False


Entries = Generator[tuple[Path, KeyPlace], None, int]
"""Keys with their places; the result is the offset after them."""


class _UnknownSyntaxError(Exception):
    """The text is not as the scanner expects it."""


def places(text: str) -> dict[Path, KeyPlace]:
    """Return the place of each key of a valid TOML text that has a value other than a table.

    An array of tables is one value, whose place is its first header.
    """
    return {path: place for path, place in all_places(text).items() if not place.is_table}


def all_places(text: str) -> dict[Path, KeyPlace]:
    """Return the places as `places` does, and also that of each table with a header or in braces."""
    found: dict[Path, KeyPlace] = {}
    try:
        for path, place in _statements(text):
            found.setdefault(path, place)
    except (_UnknownSyntaxError, RecursionError):
        pass
    return found


def _statements(text: str) -> Iterator[tuple[Path, KeyPlace]]:
    table: Path = ()
    at = _after(_BLANK, text, 0)
    while at < len(text):
        if text[at] == "[":
            is_array = text.startswith("[[", at)
            path, key = _key(text, at + 1 + is_array)
            table = path
            yield path, KeyPlace(key, key, is_table=not is_array)
            at = _expect(text, "]]" if is_array else "]", _after(_SPACE, text, key.end))
        else:
            at = yield from _pair(text, at, table)
        at = _after(_BLANK, text, at)


def _pair(text: str, at: int, table: Path) -> Entries:
    """Yield the places of `key = value`, and return the offset after it."""
    path, key = _key(text, at)
    at = _after(_SPACE, text, _expect(text, "=", _after(_SPACE, text, key.end)))
    path = (*table, *path)
    if text.startswith("{", at):
        yield path, KeyPlace(key, key, is_table=True)
        return (yield from _inline_table(text, at, path))
    end = _value(text, at)
    yield path, KeyPlace(key, Extent(at, end))
    return end


def _inline_table(text: str, at: int, table: Path) -> Entries:
    """Yield the places in `{ ... }`, and return the offset after it."""
    at = _after(_BLANK, text, at + 1)
    while not text.startswith("}", at):
        at = _after(_BLANK, text, (yield from _pair(text, at, table)))
        if text.startswith(",", at):
            at = _after(_BLANK, text, at + 1)
        elif not text.startswith("}", at):
            raise _UnknownSyntaxError
    return at + 1


def _value(text: str, at: int) -> int:
    """Return the offset after a value."""
    if text.startswith("[", at):
        at = _after(_BLANK, text, at + 1)
        while not text.startswith("]", at):
            at = _after(_BLANK, text, _value(text, at))
            at = _after(_BLANK, text, at + text.startswith(",", at))
        return at + 1
    if text.startswith("{", at):
        return _result(_inline_table(text, at, ()))
    found = _TEXT.match(text, at) or _SCALAR.match(text, at)
    if found is None:
        raise _UnknownSyntaxError
    return at + len(found[0].rstrip())


def _result(entries: Entries) -> int:
    """Return the offset after entries that do not matter."""
    while True:
        try:
            next(entries)
        except StopIteration as end:
            return int(end.value)


def _key(text: str, at: int) -> tuple[Path, Extent]:
    """Return a key, which may have several parts, and its place."""
    parts: list[str] = []
    at = start = _after(_SPACE, text, at)
    while True:
        found = _KEY.match(text, at)
        if found is None:
            raise _UnknownSyntaxError
        parts.append(_unquoted(found[0]))
        dot = _after(_SPACE, text, found.end())
        if not text.startswith(".", dot):
            return tuple(parts), Extent(start, found.end())
        at = _after(_SPACE, text, dot + 1)


def _unquoted(part: str) -> str:
    if part[0] == "'":
        return part[1:-1]
    return str(tomllib.loads(f"key = {part}")["key"]) if part[0] == '"' else part


def _expect(text: str, word: str, at: int) -> int:
    if not text.startswith(word, at):
        raise _UnknownSyntaxError
    return at + len(word)


def _after(pattern: re.Pattern[str], text: str, at: int) -> int:
    """Return the offset after what a pattern, which may be empty, matches."""
    found = pattern.match(text, at)
    return at if found is None else found.end()
