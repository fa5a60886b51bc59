"""What a name is: its declaration, its type, what is known about it, and the comment above it."""

from __future__ import annotations

import re
from typing import Any

from colony.editing.functions import FUNCTIONS
from colony.editing.index import Declaration
from colony.editing.open_file import OpenFile
from colony.editing.text import TextPosition

_MAX_LINES = 12
"""Maximum number of lines of a declaration that are shown."""

_WORD = re.compile(r"[A-Za-z_]\w*")
_COMMENT = re.compile(r"[ \t]*#[ \t]?(.*)")


def hover(file: OpenFile, position: TextPosition) -> Any:
    """Return what the editor shows about the name at a position."""
    use = file.use_at(position)
    if use is not None:
        declared = file.declaration(use[1])
        return {"contents": {"kind": "markdown", "value": described(file, declared)}, "range": use[0]}
    offset = file.lines.offset(position)
    for word in _WORD.finditer(file.text, max(0, offset - 64), min(len(file.text), offset + 64)):
        if word.start() <= offset <= word.end() and word[0] in FUNCTIONS:
            usage, meaning = FUNCTIONS[word[0]]
            value = f"```colony\n{usage}\n```\n{meaning}"
            return {"contents": {"kind": "markdown", "value": value}, "range": file.lines.range(*word.span())}
    return None


def described(file: OpenFile, declared: Declaration) -> str:
    """Return a declaration as Markdown."""
    if declared.kind == "file":
        return f"`{file.known.files[declared.file].path}`"
    text = file.text_of(declared)
    shown = _shown(text, declared)
    facts = [f"- {fact}" for fact in declared.facts]
    if declared.parent >= 0:
        owner = file.declaration(declared.parent)
        facts.append(f"- {declared.kind} of `{owner.name}`")
    if declared.base >= 0:
        facts.append(f"- derived from `{file.declaration(declared.base).name}`")
    parts = [f"```colony\n{shown}\n```", comment_of(text, declared), "\n".join(facts)]
    return "\n\n".join(part for part in parts if part)


def _shown(text: str, declared: Declaration) -> str:
    lines = text[declared.first : declared.last].splitlines()
    if declared.kind in ("phase", "variable", "member", "parameter"):
        lines = [f"{declared.name}{f' : {declared.type}' if declared.type else ''}"]
    more = ["..."] if len(lines) > _MAX_LINES else []
    lines = [*lines[:_MAX_LINES], *more]
    if declared.kind in ("let", "state", "param") and declared.type and lines:
        lines[0] += f"    # : {declared.type}"
    return "\n".join(lines)


def comment_of(text: str, declared: Declaration) -> str:
    """Return the comment lines right above a declaration, or else the one at the end of its first line."""
    start = text.rfind("\n", 0, declared.first) + 1
    found: list[str] = []
    while start > 0:
        before = text.rfind("\n", 0, start - 1) + 1
        match = _COMMENT.fullmatch(text[before : start - 1].rstrip("\r"))
        if match is None:
            break
        found.insert(0, match[1])
        start = before
    if found:
        return "\n".join(found)
    end = text.find("\n", declared.first)
    line = text[declared.first : len(text) if end < 0 else end]
    match = re.search(r"#[ \t]?(.*)$", line.rstrip("\r"))
    return "" if match is None else match[1]
