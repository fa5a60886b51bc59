"""Recovery from a syntax error: the declarations before it, the names lost in it, and where to resume.

Imported only after an error, since compiling its patterns would add to the start-up time of every command.
"""

from __future__ import annotations

import re
from typing import cast

from colony.dsl import ast
from colony.dsl.parser import Unexpected

_DECLARATION = re.compile(
    r"^([ \t]*)(?:(?:robot|enum|import|param|let|state|next|machine|(?:failsafe[ \t]+)?module|network|limit"
    r"|contract|reach|test)"
    r"(?:[ \t]+[A-Za-z_\"{]|[ \t]*[{\"]))",
    re.MULTILINE,
)
_DECLARED = re.compile(
    r"\b(?:robot|enum|param|let|state|machine|module|sensor|actuator|as)[ \t]+([A-Za-z_]\w*)"
    r"|^[ \t]*([A-Za-z_]\w*)[ \t]*=(?!=)",
    re.MULTILINE,
)


CONTEXTUAL_KEYWORDS = frozenset(
    "ROBOT FRAME JITTER SENSOR ACTUATOR RANGE DEFAULT WITHIN FROM TO IDLE ON_LOSS STOP DEGRADE ENUM "
    "IMPORT AS PARAM LET STATE NEXT MACHINE START WHEN MODULE DO PYTHON READS COMMANDS RATE "
    "NETWORK LIMIT CONTRACT TEST AT EVERY GIVEN EXPECT FOR ACTIVE COMMANDED LANGUAGE FAILSAFE TAKEN "
    "AGO INPUT BEARING STEP TIME REACH".split()
)
"""Contextual keywords (except `any`, which is used where phase names are)."""


def lost_names(text: str) -> set[str]:
    """Return the names that a piece of text seems to declare."""
    return {a or b for a, b in _DECLARED.findall(text)}


def expected_terminals(problem: Unexpected) -> frozenset[str]:
    """Return the terminals allowed at the error, without contextual keywords where any name is allowed."""
    accepted = problem.accepted
    return accepted - CONTEXTUAL_KEYWORDS if {"NAME", *CONTEXTUAL_KEYWORDS} <= accepted else accepted


def complete_declarations(problem: Unexpected) -> list[ast.Declaration]:
    """Return the declarations that were read before the error, from the parser's stack."""
    for value in problem.values[:2]:
        if isinstance(value, list):
            return value
        if isinstance(value, DECLARATIONS):
            return [cast("ast.Declaration", value)]
    return []


def language_line(problem: Unexpected) -> ast.LanguageDecl | None:
    """Return the line with the version of the language, if it was read before the error."""
    match problem.values:
        case (ast.LanguageDecl() as line, *_):
            return line
        case (word, version) if getattr(word, "type", "") == "LANGUAGE":  # the error is right after it
            return ast.LanguageDecl(version=version.value, start=word.start_pos, end=version.end_pos)
    return None


DECLARATIONS: tuple[type, ...] = ast.Declaration.__args__


def next_declaration(text: str, declaration_start: int, error_offset: int) -> int:
    """Return the offset at which to resume: a declaration that begins a line at or after the error."""
    begin, indent = _begin_and_indent(text, declaration_start)
    line = text.rfind("\n", 0, error_offset) + 1
    search_from = line if line > begin else text.find("\n", max(error_offset, begin))
    while search_from >= 0:
        match = _DECLARATION.search(text, search_from)
        if match is None:
            break
        if len(match[1]) <= indent:
            return match.start()
        search_from = match.end()
    return len(text)


def new_declaration(text: str, declaration_start: int, error_offset: int) -> int | None:
    """Return the offset, in the line of the error, at which a new declaration seems to begin, if any."""
    begin, indent = _begin_and_indent(text, declaration_start)
    line = text.rfind("\n", 0, error_offset) + 1
    match = _DECLARATION.match(text, line)
    if match is None or line <= begin or len(match[1]) > indent or match.end(1) > error_offset:
        return None
    return match.end(1)


def _begin_and_indent(text: str, declaration_start: int) -> tuple[int, int]:
    """Return the offset of the word that begins the declaration, and the declaration's indentation."""
    blanks = re.compile(r"(?:[ \t\r\n\f]|#[^\r\n]*)*").match(text, declaration_start)
    begin = blanks.end() if blanks else declaration_start
    return begin, begin - (text.rfind("\n", 0, begin) + 1)
