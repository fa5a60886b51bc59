"""The parameters of the call around a place."""

from __future__ import annotations

from typing import Any

from colony.editing.features.hover import comment_of
from colony.editing.functions import FUNCTIONS
from colony.editing.names import Names, dotted, open_parenthesis
from colony.editing.open_file import OpenFile
from colony.editing.text import Lexeme, TextPosition, declaration_start, lexemes


def signature_help(file: OpenFile, position: TextPosition) -> Any:
    """Return the call around a position with its parameters, and which of them stands there."""
    offset = file.lines.offset(position)
    before = [
        x for x in lexemes(file.text, declaration_start(file.text, offset), offset) if x.kind != "comment"
    ]
    place = open_parenthesis(before)
    path = dotted(before[:place]) if place >= 0 else []
    if not path:
        return None
    commas, named = _argument(before[place + 1 :])
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


def _argument(inside: list[Lexeme]) -> tuple[int, str]:
    """Return the number of commas of a call so far, and the name of the argument after the last one."""
    depth = commas = 0
    named = ""
    for i, lexeme in enumerate(inside):
        depth += (lexeme.text in "([{") - (lexeme.text in ")]}")
        if depth == 0 and lexeme.text == ",":
            commas, named = commas + 1, ""
        elif depth == 0 and lexeme.text == "=" and i:
            named = inside[i - 1].text
    return commas, named
