"""The parameters of the call around a place."""

from __future__ import annotations

from typing import Any

from colony.editing.features.hover import comment_of
from colony.editing.functions import FUNCTIONS
from colony.editing.names import Names
from colony.editing.open_file import OpenFile
from colony.editing.text import Lexeme, TextPosition, declaration_start, lexemes


def signature_help(file: OpenFile, position: TextPosition) -> Any:
    """Return the call around a position with its parameters, and which of them stands there."""
    offset = file.lines.offset(position)
    before = [
        x for x in lexemes(file.text, declaration_start(file.text, offset), offset) if x.kind != "comment"
    ]
    found = _open_call(before)
    if found is None:
        return None
    path, commas, named = found
    names = Names(file, offset)
    for number in names.resolve(path):
        declared = file.declaration(number)
        kinds = {"function": ("parameter",), "actuator": ("field",), "module": ("input", "param")}
        if declared.kind not in kinds:
            continue
        own = [file.declaration(n) for n in names.of_kind(names.members(number), *kinds[declared.kind])]
        labels = [f"{d.name} : {d.type}" if d.type else d.name for d in own]
        order = [d.name for d in own]
        active = order.index(named) if named in order else commas
        label = f"{'.'.join(path)}({', '.join(labels)})"
        return _help(label, labels, active, comment_of(file.text_of(declared), declared))
    if len(path) == 1 and path[0] in FUNCTIONS:
        usage, meaning = FUNCTIONS[path[0]]
        labels = usage[usage.index("(") + 1 : -1].split(", ")
        return _help(usage, labels, min(commas, len(labels) - 1), meaning)
    return None


def _help(label: str, parameters: list[str], active: int, text: str) -> Any:
    signature = {"label": label, "documentation": text, "parameters": [{"label": p} for p in parameters]}
    return {"signatures": [signature], "activeSignature": 0, "activeParameter": active}


def _open_call(before: list[Lexeme]) -> tuple[list[str], int, str] | None:
    """Return the name of the call that is open, the commas in it so far, and the argument named last."""
    depth, commas, named = 0, 0, ""
    for i in range(len(before) - 1, -1, -1):
        text = before[i].text
        if text in ")]}":
            depth += 1
        elif text in "([{":
            depth -= 1
            if depth < 0:
                break
        elif depth == 0 and text == ",":
            commas += 1
        elif depth == 0 and text == "=" and commas == 0 and i:
            named = before[i - 1].text
    else:
        return None
    if before[i].text != "(":
        return None
    path: list[str] = []
    for lexeme in reversed(before[:i]):
        if lexeme.kind != ("word" if len(path) % 2 == 0 else "sign") or (
            len(path) % 2 and lexeme.text != "."
        ):
            break
        path.append(lexeme.text)
    parts = [part for part in reversed(path) if part != "."]
    return (parts, commas, named) if parts else None
