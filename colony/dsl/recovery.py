"""Recovery from a syntax error: what was read before it, the names lost in it, and where to resume.

Imported only after an error: compiling its patterns would add to the start-up time of every command.
"""

from __future__ import annotations

import re
from typing import cast

from colony.dsl import ast
from colony.dsl.lalr import UnexpectedInputError

_DECLARATION = re.compile(
    r"^([ \t]*)(?:(?:robot|enum|import|param|let|state|next|machine|module|network|limit|contract|test)"
    r"(?:[ \t]+[A-Za-z_\"{]|[ \t]*[{\"]))",
    re.MULTILINE,
)
_DECLARED = re.compile(
    r"\b(?:robot|enum|param|let|state|machine|module|sensor|actuator|as)[ \t]+([A-Za-z_]\w*)"
    r"|^[ \t]*([A-Za-z_]\w*)[ \t]*=(?!=)",
    re.MULTILINE,
)


WORDS = frozenset(
    "ROBOT FRAME SENSOR ACTUATOR RANGE DEFAULT WITHIN FROM TO IDLE ON_LOSS STOP DEGRADE ENUM "
    "IMPORT AS PARAM LET STATE NEXT MACHINE START WHEN MODULE DO PYTHON READS COMMANDS RATE "
    "NETWORK LIMIT CONTRACT TEST AT EVERY GIVEN EXPECT FOR ACTIVE COMMANDED".split()
)
"""The words that are keywords in their context only (except `any`, which stands for phases)."""


def lost_names(text: str) -> set[str]:
    """Return the names that a piece of text seems to declare."""
    return {a or b for a, b in _DECLARED.findall(text)}


def expected(problem: UnexpectedInputError) -> frozenset[str]:
    """Return the terminals allowed at the error, without words that would be names there."""
    found = problem.accepted
    return found - WORDS if {"NAME", *WORDS} <= found else found


def complete_declarations(problem: UnexpectedInputError) -> list[ast.Declaration]:
    """Return the declarations that were read before the error, from the parser's stack."""
    first: object = problem.values[0] if problem.values else None
    if isinstance(first, list):
        return first
    return [cast("ast.Declaration", first)] if isinstance(first, DECLARATIONS) else []


DECLARATIONS: tuple[type, ...] = ast.Declaration.__args__


def next_declaration(text: str, failed: int, at: int) -> int:
    """Return the offset at which to resume: a line, at or after the error, that begins a declaration."""
    begin, indent = _begin_and_indent(text, failed)
    line = text.rfind("\n", 0, at) + 1
    search_from = line if line > begin else text.find("\n", max(at, begin))
    while search_from >= 0:
        match = _DECLARATION.search(text, search_from)
        if match is None:
            break
        if len(match[1]) <= indent:
            return match.start()
        search_from = match.end()
    return len(text)


def declaration_begun(text: str, failed: int, at: int) -> int | None:
    """Return the offset, in the line of the error, at which a new declaration seems to begin, if any."""
    begin, indent = _begin_and_indent(text, failed)
    line = text.rfind("\n", 0, at) + 1
    match = _DECLARATION.match(text, line)
    if match is None or line <= begin or len(match[1]) > indent or match.end(1) > at:
        return None
    return match.end(1)


def _begin_and_indent(text: str, failed: int) -> tuple[int, int]:
    """Return the offset of the word that begins the declaration, and the declaration's indentation."""
    blanks = re.compile(r"(?:[ \t\r\n\f]|#[^\r\n]*)*").match(text, failed)
    begin = blanks.end() if blanks else failed
    return begin, begin - (text.rfind("\n", 0, begin) + 1)
