"""Parsing of a text to its syntax tree, with all syntax errors of a file in one run.

Panic-mode recovery: after an error the parser restarts at the next line that begins a declaration and is not
indented deeper than the failed one. Declarations before the error are kept. The names that the skipped text
seems to declare are recorded, so that they are not reported as unknown.
"""

from __future__ import annotations

import re
from decimal import Decimal
from typing import TYPE_CHECKING

from colony.dsl import ast
from colony.ir.expression import NESTING_LIMIT
from colony.ir.version import LANGUAGE
from colony.record import Record, record
from colony.text.diagnostics import Diagnostic, DiagnosticError, error, note
from colony.text.source import Source, Span

if TYPE_CHECKING:
    from lark import Token

# --- language version ---------------------------------------------------------------------------------
#
# The line `language 1`: files of other versions are refused, and files without the line are noted.

VERSION_LINE = f"language {LANGUAGE}"
"""The line that says the version of a file."""

UNVERSIONED = "N001"
"""The code of the note for a file without it."""


def version_error(source: Source, line: ast.LanguageDecl | None) -> Diagnostic | None:
    """Return the error of a file whose `language` line names another version, None for any other file."""
    if line is None or line.version == str(LANGUAGE):
        return None
    span = Span(source, line.start, line.end)
    message = f"found version {line.version} of the language; this is version {LANGUAGE}"
    is_newer = line.version.isdecimal() and Decimal(line.version) > LANGUAGE
    hint = "a newer colony reads it" if is_newer else f"write `{VERSION_LINE}`"
    return error("E008", span, message, hint)


def version_note(source: Source) -> Diagnostic:
    """Return the note for a file that does not name its version."""
    hint = f"write `{VERSION_LINE}` before the first declaration"
    return note(UNVERSIONED, Span(source, 0, 1), f"read as version {LANGUAGE} of the language", hint)


# --- parse --------------------------------------------------------------------------------------------

MAX_SYNTAX_ERRORS = 20

SYNTAX_CODES = frozenset({"E004", "E005", "E006", "E007"})
"""The codes of the errors that `parse` finds."""

_BRACKETS = re.compile(r'"[^"\r\n]*"|#[^\r\n]*|[(){}\[\]]')


@record
class Parsed(Record):
    """The tree of the readable parts, the errors, and the names that unreadable parts seem to declare."""

    file: ast.File
    diagnostics: tuple[Diagnostic, ...] = ()
    lost_names: frozenset[str] = frozenset()


def parse(source: Source) -> Parsed:
    """Parse a whole file; invalid text raises no exception."""
    depth_error = _check_depth(source)
    if depth_error:
        from colony.dsl import parser

        lost_names = frozenset(parser.lost_names(source.text))
        return Parsed(file=ast.File(declarations=()), diagnostics=(depth_error,), lost_names=lost_names)
    from colony.dsl.parser import Unexpected, parse_from

    text, start = source.text, 0
    declarations: list[ast.Declaration] = []
    diagnostics: list[Diagnostic] = []
    lost: set[str] = set()
    language: ast.LanguageDecl | None = None
    while isinstance(found := parse_from(text, start), Unexpected):
        from colony.dsl import parser
        from colony.dsl.syntax_errors import describe

        line = parser.language_line(found)
        language = language or line
        complete = parser.complete_declarations(found)
        declarations += complete
        declaration_start = complete[-1].end if complete else line.end if line else start
        diagnostics.append(describe(source, found, declaration_start))
        start = parser.next_declaration(text, declaration_start, diagnostics[-1].span.start)
        lost |= parser.lost_names(text[declaration_start:start])
        if start >= len(text):
            break
        if len(diagnostics) == MAX_SYNTAX_ERRORS:
            span = Span(source, start, start + 1)
            diagnostics.append(
                error("E007", span, f"{MAX_SYNTAX_ERRORS} syntax errors; the rest of the file is not read")
            )
            lost |= parser.lost_names(text[start:])
            break
    else:
        language = language or found.language
        declarations += found.declarations
    return Parsed(
        file=ast.File(language=language, declarations=tuple(declarations), start=0, end=len(text)),
        diagnostics=tuple(diagnostics),
        lost_names=frozenset(lost),
    )


def parse_with_tokens(source: Source) -> tuple[ast.File, list[Token]]:
    """Parse a file without errors, and return its tokens, too.

    Raises:
        DiagnosticError: the file has syntax errors, or another version.
    """
    from colony.dsl.parser import read_tokens

    found = None if _check_depth(source) else read_tokens(source.text)
    if found is None:
        raise DiagnosticError(parse(source).diagnostics)
    problem = version_error(source, found[0].language)
    if problem is not None:
        raise DiagnosticError((problem,))
    return found


def _check_depth(source: Source) -> Diagnostic | None:
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
                    f"brackets nest more than {NESTING_LIMIT} levels deep",
                    "name parts of the expression with `let`, or parts of the network with wires",
                )
        elif bracket in ")]}":
            depth = max(depth - 1, 0)
    return None
