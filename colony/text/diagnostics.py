"""Errors and warnings as data, and the one place where they are rendered.

A stage that finds something wrong appends a `Diagnostic` to a list and goes on; what cannot go on raises
`Failure` with all that was found. Nothing else in the project formats a message for a person.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from colony.text.source import Span

Severity = Literal["error", "warning"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnostic:
    """One finding: a stable code, where, what was found and expected, and what to do about it."""

    code: str
    span: Span
    message: str
    hint: str | None = None
    severity: Severity = "error"


class Failure(Exception):
    """A stage could not give its result; `diagnostics` holds everything that it found, at least one."""

    def __init__(self, diagnostics: Iterable[Diagnostic]) -> None:
        self.diagnostics = tuple(diagnostics)
        super().__init__("\n".join(headline(d) for d in self.diagnostics))


def error(code: str, span: Span, message: str, hint: str | None = None) -> Diagnostic:
    """An error at `span`."""
    return Diagnostic(code=code, span=span, message=message, hint=hint)


def warning(code: str, span: Span, message: str, hint: str | None = None) -> Diagnostic:
    """A warning at `span`."""
    return Diagnostic(code=code, span=span, message=message, hint=hint, severity="warning")


def headline(diagnostic: Diagnostic) -> str:
    """`file:line:col: error[E012]: message`, on one line."""
    span = diagnostic.span
    line, column = span.source.position(span.start)
    return (
        f"{span.source.name}:{line}:{column}: {diagnostic.severity}[{diagnostic.code}]: {diagnostic.message}"
    )


_WIDEST_LINE = 160


def render(diagnostic: Diagnostic) -> str:
    """The headline, the source line with a caret below it, and the hint."""
    span = diagnostic.span
    line, column = span.source.position(span.start)
    text = span.source.line(line)
    width = min(max(span.end - span.start, 1), max(len(text) - column + 1, 1))
    if len(text) > _WIDEST_LINE:
        left = max(0, column - 1 - _WIDEST_LINE // 2)
        text = text[left : left + _WIDEST_LINE]
        column -= left
        width = min(width, max(len(text) - column + 1, 1))
    shown = "".join(c if c.isprintable() else " " for c in text)
    out = [headline(diagnostic)]
    if shown.strip():
        number = str(line)
        out.append(f"  {number} | {shown}")
        out.append(f"  {' ' * len(number)} | {' ' * (column - 1)}{'^' * width}")
    if diagnostic.hint:
        out.append(f"  hint: {diagnostic.hint}")
    return "\n".join(out)


def to_rows(diagnostics: Sequence[Diagnostic]) -> list[dict[str, object]]:
    """An object a diagnostic, for JSON, with 1-based lines and columns."""
    rows: list[dict[str, object]] = []
    for d in diagnostics:
        line, column = d.span.source.position(d.span.start)
        end_line, end_column = d.span.source.position(d.span.end)
        row: dict[str, object] = {"file": d.span.source.name, "line": line, "column": column}
        row |= {"end_line": end_line, "end_column": end_column}
        row |= {"severity": d.severity, "code": d.code, "message": d.message, "hint": d.hint}
        rows.append(row)
    return rows


def to_json(diagnostics: Sequence[Diagnostic]) -> str:
    """A JSON array of `to_rows`."""
    import json

    return json.dumps(to_rows(diagnostics), indent=2)


def has_errors(diagnostics: Iterable[Diagnostic]) -> bool:
    """Whether any of them is an error."""
    return any(d.severity == "error" for d in diagnostics)


def in_order(diagnostics: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """By file (as first met) and place, each said once."""
    files: dict[int, int] = {}
    unique: dict[tuple[int, int, str, str], Diagnostic] = {}
    for d in diagnostics:
        file = files.setdefault(id(d.span.source), len(files))
        unique.setdefault((file, d.span.start, d.code, d.message), d)
    return tuple(unique[key] for key in sorted(unique, key=lambda k: (k[0], k[1])))
