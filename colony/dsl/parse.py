"""Text to syntax tree, reporting every syntax error of a file in one go.

Panic-mode recovery: after an error the parser starts anew at the next line that begins a declaration and is
indented no deeper than the one that failed. What was read before the error is kept; the names that the
skipped text declares are remembered, so that nobody calls them unknown.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Any, cast

from lark import Lark, Tree
from lark.exceptions import UnexpectedInput

from colony.diagnostics import Diagnostic, error
from colony.dsl import ast, tables
from colony.dsl.build import Builder
from colony.dsl.syntax_errors import describe
from colony.ir.expression import NESTING_LIMIT
from colony.source import Source, Span

MAX_SYNTAX_ERRORS = 20

_BRACKETS = re.compile(r'"[^"\n]*"|#[^\n]*|[(){}\[\]]')
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Parsed:
    """The tree of what could be read, the errors, and the names that the unreadable parts seem to declare."""

    file: ast.File
    diagnostics: tuple[Diagnostic, ...] = ()
    lost_names: frozenset[str] = frozenset()


def parse(source: Source) -> Parsed:
    """Parse a whole file; never raises for bad text."""
    too_deep = _too_deep(source)
    if too_deep:
        return Parsed(file=ast.File(declarations=()), diagnostics=(too_deep,))
    text, start = source.text, 0
    declarations: list[ast.Declaration] = []
    diagnostics: list[Diagnostic] = []
    lost: set[str] = set()
    while True:
        try:
            file = _parser().parse(" " * start + text[start:])
        except UnexpectedInput as problem:
            kept = _complete_declarations(problem)
            declarations += kept
            failed = kept[-1].end if kept else start
            diagnostics.append(describe(source, problem, failed))
            at = diagnostics[-1].span.start
            start = _next_declaration(text, failed, at)
            lost |= {a or b for a, b in _DECLARED.findall(text[failed:start])}
            if start >= len(text):
                break
            if len(diagnostics) == MAX_SYNTAX_ERRORS:
                span = Span(source, start, start + 1)
                diagnostics.append(
                    error("E007", span, f"{MAX_SYNTAX_ERRORS} syntax errors; the rest is not read")
                )
                lost |= {a or b for a, b in _DECLARED.findall(text[start:])}
                break
        else:
            declarations += file.declarations  # type: ignore[attr-defined]
            break
    return Parsed(
        file=ast.File(declarations=tuple(declarations), start=0, end=len(text)),
        diagnostics=tuple(diagnostics),
        lost_names=frozenset(lost),
    )


@cache
def _parser() -> Lark:
    return tables.load(Builder())


def _too_deep(source: Source) -> Diagnostic | None:
    depth = 0
    for match in _BRACKETS.finditer(source.text):
        bracket = match[0]
        if bracket in "([{":
            depth += 1
            if depth > NESTING_LIMIT:
                span = Span(source, match.start(), match.end())
                return error(
                    "E004",
                    span,
                    f"brackets nest deeper than {NESTING_LIMIT}",
                    "name parts of the expression with `let`, or parts of the network with wires",
                )
        elif bracket in ")]}":
            depth = max(depth - 1, 0)
    return None


def _complete_declarations(problem: UnexpectedInput) -> list[ast.Declaration]:
    """The declarations that were read before the error: they stand on the parser's stack."""
    interactive: Any = getattr(problem, "interactive_parser", None)
    if interactive is None:
        return []
    found: list[ast.Declaration] = []
    for value in interactive.parser_state.value_stack:
        if isinstance(value, Tree) and "file_star" in str(value.data):
            found += cast("list[ast.Declaration]", value.children)
        elif isinstance(value, DECLARATIONS) and not found:
            found.append(cast("ast.Declaration", value))
        else:
            break
    return found


DECLARATIONS: tuple[type, ...] = ast.Declaration.__args__


def _next_declaration(text: str, failed: int, at: int) -> int:
    """Where to read on: the offset of a line, at or after the error, that begins a declaration."""
    word = re.compile(r"(?:[ \t\r\n\f]|#[^\n]*)*").match(text, failed)
    begin = word.end() if word else failed
    indent = begin - (text.rfind("\n", 0, begin) + 1)
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
