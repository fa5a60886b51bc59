"""Semantic tokens and folds, from the words of the text as it is now."""

from __future__ import annotations

from typing import Any

from colony.editing.open_file import OpenFile
from colony.editing.text import KEYWORDS, lexemes

TOKEN_TYPES = (
    *("comment", "string", "number", "keyword", "variable", "parameter", "property", "enumMember", "enum"),
    *("function", "class", "namespace", "event", "type"),
)
"""The legend, in the names that editors color."""

_TYPES = {
    "sensor": "property",
    "input": "property",
    "actuator": "class",
    "field": "property",
    "module": "class",
    "task": "class",
    "sequence": "enum",
    "machine": "enum",
    "enum": "enum",
    "member": "enumMember",
    "phase": "enumMember",
    "let": "variable",
    "state": "variable",
    "param": "variable",
    "wire": "variable",
    "function": "function",
    "parameter": "parameter",
    "variable": "parameter",
    "alias": "namespace",
    "contract": "event",
    "reach": "event",
    "assume": "event",
    "robot": "type",
}


def semantic_tokens(file: OpenFile) -> dict[str, list[int]]:
    """Return all tokens, each as line, start, length, type and modifiers, relative to the one before."""
    kinds = {
        now: _TYPES.get(file.declaration(number).kind)
        for start, _, number in file.file.uses
        if (now := file.drift.to_now(start)) is not None
    }
    types = {name: i for i, name in enumerate(TOKEN_TYPES)}
    data: list[int] = []
    last_line = last_start = 0
    for lexeme in lexemes(file.text):
        name = lexeme.kind
        if name == "sign":
            continue
        if name == "word":
            known = kinds.get(lexeme.start) or ("keyword" if lexeme.text in KEYWORDS else None)
            if known is None:
                continue
            name = known
        elif lexeme.start in kinds:  # the title of a test, the path of an import
            name = "string"
        place = file.lines.range(lexeme.start, lexeme.end)
        line, start = place.start.line, place.start.character
        since = start - last_start if line == last_line else start
        data += [line - last_line, since, place.end.character - start, types[name], 0]
        last_line, last_start = line, start
    return {"data": data}


def folds(file: OpenFile) -> list[Any]:
    """Return the lines between braces, and runs of comment lines."""
    found: list[Any] = []
    braces: list[int] = []
    comments: list[int] = []
    lines = file.lines

    def end_comments() -> None:
        if len(comments) > 1:
            found.append({"startLine": comments[0], "endLine": comments[-1], "kind": "comment"})
        comments.clear()

    last_line = -1
    for lexeme in lexemes(file.text):
        line = lines.position(lexeme.start).line
        if lexeme.kind == "comment" and line != last_line:
            if comments and line != comments[-1] + 1:
                end_comments()
            comments.append(line)
        elif lexeme.kind != "comment":
            end_comments()
        last_line = line
        if lexeme.text == "{":
            braces.append(line)
        elif lexeme.text == "}" and braces:
            first = braces.pop()
            if line > first + 1:
                found.append({"startLine": first, "endLine": line - 1})
    end_comments()
    return sorted(found, key=lambda fold: (fold["startLine"], fold["endLine"]))
