"""Outlines: the declarations of a document, and those of a workspace by name."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any

from colony.editing.open_file import OpenFile, uri_of
from colony.editing.server.protocol import DocumentSymbol
from colony.editing.text import Lines, TextRange

KINDS = {
    kind: number
    for number, kinds in (
        (1, "file"),
        (3, "alias"),
        (5, "robot"),
        (6, "module task"),
        (7, "contract reach assume"),
        (8, "field"),
        (10, "enum"),
        (11, "sequence machine"),
        (12, "function"),
        (13, "let variable parameter state wire"),
        (14, "param"),
        (20, "input sensor"),
        (22, "member phase"),
        (23, "actuator"),
        (24, "test"),
    )
    for kind in kinds.split()
}
"""Kinds of symbols, by kinds of declarations."""

_MAX_SYMBOLS = 200
"""Maximum number of symbols of a workspace in an answer."""


def document_symbols(file: OpenFile) -> list[DocumentSymbol]:
    """Return the declarations of a document; those inside others below them."""
    found: dict[int, DocumentSymbol] = {}
    top: list[DocumentSymbol] = []
    for number, declared in file.own_declarations():
        if declared.kind in ("variable", "parameter", "alias"):
            continue
        name, whole = file.place(declared.start, declared.end), file.place(declared.first, declared.last)
        if name is None or whole is None:
            if name is None:
                continue
            whole = name
        if not _contains(whole, name):
            whole = name
        symbol = DocumentSymbol(declared.name or "?", KINDS[declared.kind], whole, name, declared.type)
        found[number] = symbol
        parent = found.get(declared.parent)
        (top if parent is None else parent.children).append(symbol)
    return top


def _contains(whole: TextRange, part: TextRange) -> bool:
    start, end = whole.start, whole.end
    return (start.line, start.character) <= (part.start.line, part.start.character) and (
        part.end.line,
        part.end.character,
    ) <= (end.line, end.character)


_DECLARED = re.compile(
    r"^(?P<indent>[ \t]*)(?:failsafe[ \t]+|tunable[ \t]+)?(?P<kind>robot|enum|param|let|state|machine"
    r"|sequence|module|input|sensor|actuator|contract|reach|assume)[ \t]+(?P<name>[A-Za-z_]\w*)",
    re.MULTILINE,
)


def workspace_symbols(query: str, files: Iterable[OpenFile], paths: Iterable[str]) -> list[Any]:
    """Return the declarations, of open documents and of files, with the letters of `query` in their order."""
    wanted = re.compile(".*?".join(re.escape(c) for c in query), re.IGNORECASE)
    opened = {file.path: file.text for file in files}
    found: list[Any] = []
    for path in dict.fromkeys((*opened, *paths)):
        try:
            text = opened[path] if path in opened else _text(path, Path(path).stat().st_mtime_ns)
        except OSError:
            continue
        lines = Lines(text)
        for match in _DECLARED.finditer(text):
            if wanted.search(match["name"]):
                location = {"uri": uri_of(path), "range": lines.range(*match.span("name"))}
                found.append({"name": match["name"], "kind": KINDS[match["kind"]], "location": location})
                if len(found) == _MAX_SYMBOLS:
                    return found
    return found


@lru_cache(maxsize=512)
def _text(path: str, mtime_ns: int) -> str:
    return Path(path).read_text(encoding="utf-8", errors="replace")
