"""Semantic tokens and folds, from the words of the text as it is now."""

from __future__ import annotations

import re
from typing import Any

from colony.editing.open_file import OpenFile
from colony.editing.text import KEYWORDS, units

TOKEN_TYPES = (
    *("comment", "string", "number", "keyword", "variable", "parameter", "property", "enumMember", "enum"),
    *("function", "class", "namespace", "event", "type"),
)
"""The legend, in the names that editors color."""

_TYPES = {
    kind: type_
    for type_, kinds in (
        ("property", "sensor input field"),
        ("class", "actuator module task"),
        ("enum", "sequence machine enum"),
        ("enumMember", "member phase"),
        ("variable", "let state param wire"),
        ("function", "function"),
        ("parameter", "parameter variable"),
        ("namespace", "alias"),
        ("event", "contract reach assume"),
        ("type", "robot"),
    )
    for kind in kinds.split()
}

_COLORED = re.compile(
    r"(#[^\r\n]*)|(\"[^\"\r\n]*\"?)|([0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?)|([A-Za-z_][A-Za-z0-9_]*)"
)
_WORD = 4
"""The group of words in it."""

_FOLDED = re.compile(r"(^[ \t]*#[^\r\n]*)|#[^\r\n]*|\"[^\"\r\n]*\"?|([{}])", re.MULTILINE)


def semantic_tokens(file: OpenFile) -> dict[str, list[int]]:
    """Return all tokens, each as line, start, length, type and modifiers, relative to the one before."""
    types = {name: i for i, name in enumerate(TOKEN_TYPES)}
    of_kind = {kind: types[name] for kind, name in _TYPES.items()}
    declarations, to_now = file.known.declarations, file.drift.to_now
    known = {
        to_now(start): of_kind[declarations[number].kind]
        for start, _, number in file.file.uses
        if declarations[number].kind in of_kind
    }
    text, starts, keyword = file.text, file.lines.starts, types["keyword"]
    is_ascii = text.isascii()
    data: list[int] = []
    line = last_line = last_start = 0
    for match in _COLORED.finditer(text):
        start, end = match.span()
        group = match.lastindex or 0
        type_: int | None = group - 1  # as the legend begins
        if group == _WORD:
            type_ = known.get(start)
            if type_ is None and match[0] in KEYWORDS:
                type_ = keyword
        if type_ is None:
            continue
        while line + 1 < len(starts) and starts[line + 1] <= start:
            line += 1
        column, length = start - starts[line], end - start
        if not is_ascii:
            column, length = units(text[starts[line] : start]), units(match[0])
        data += (line - last_line, column - last_start if line == last_line else column, length, type_, 0)
        last_line, last_start = line, column
    return {"data": data}


def folds(file: OpenFile) -> list[Any]:
    """Return the lines between braces, and runs of comment lines."""
    found: list[Any] = []
    braces: list[int] = []
    starts, line = file.lines.starts, 0
    first_comment = last_comment = -2
    for match in _FOLDED.finditer(file.text):
        while line + 1 < len(starts) and starts[line + 1] <= match.start():
            line += 1
        if match[1] is not None:
            if line != last_comment + 1:
                first_comment = line
            elif line == first_comment + 1:
                found.append({"startLine": first_comment, "endLine": line, "kind": "comment"})
            else:
                found[-1]["endLine"] = line  # nothing stands between two comment lines
            last_comment = line
        elif match[2] == "{":
            braces.append(line)
        elif match[2] == "}" and braces:
            first = braces.pop()
            if line > first + 1:
                found.append({"startLine": first, "endLine": line - 1})
    return sorted(found, key=lambda fold: (fold["startLine"], fold["endLine"]))
