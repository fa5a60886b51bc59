"""The line `language 1`: files of other versions are refused, and files without the line are noted."""

from __future__ import annotations

from decimal import Decimal

from colony.dsl import ast
from colony.ir.version import LANGUAGE
from colony.text.diagnostics import Diagnostic, error, note
from colony.text.source import Source, Span

VERSION_LINE = f"language {LANGUAGE}"
"""The line that says the version of a file."""


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
    return note("N001", Span(source, 0, 1), f"read as version {LANGUAGE} of the language", hint)
