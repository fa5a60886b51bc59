"""Errors, warnings and notes as data, and their rendering.

A stage that finds a problem appends a `Diagnostic` to a list and continues; if it cannot continue, it raises
`DiagnosticError` with all findings so far.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from colony.text.source import Span

Severity = Literal["error", "warning", "note"]
"""Severity of a finding. A note is information: it never makes a command fail."""


@dataclass(frozen=True, slots=True)
class Label:
    """Another span that a finding refers to, with a note such as "first declared here"."""

    span: Span
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnostic:
    """A finding: its stable code, its span, what was found and expected, and a hint on how to fix it."""

    code: str
    span: Span
    message: str
    hint: str | None = None
    severity: Severity = "error"
    labels: tuple[Label, ...] = ()


class DiagnosticError(Exception):
    """The failure of a stage; `diagnostics` holds all its findings, at least one."""

    def __init__(self, diagnostics: Iterable[Diagnostic]) -> None:
        self.diagnostics = tuple(diagnostics)
        super().__init__(
            "\n".join(headline(d) + (f" ({d.hint})" if d.hint else "") for d in self.diagnostics)
        )


def error(code: str, span: Span, message: str, hint: str | None = None, *labels: Label) -> Diagnostic:
    """Return an error at `span`."""
    return Diagnostic(code=code, span=span, message=message, hint=hint, labels=labels)


def warning(code: str, span: Span, message: str, hint: str | None = None) -> Diagnostic:
    """Return a warning at `span`."""
    return Diagnostic(code=code, span=span, message=message, hint=hint, severity="warning")


def note(code: str, span: Span, message: str, hint: str | None = None) -> Diagnostic:
    """Return a note at `span`: nothing is wrong, but the reader may not know it."""
    return Diagnostic(code=code, span=span, message=message, hint=hint, severity="note")


def headline(diagnostic: Diagnostic) -> str:
    """Return `file:line:col: error[E012]: message`, on one line."""
    return f"{diagnostic.span.place}: {diagnostic.severity}[{diagnostic.code}]: {diagnostic.message}"


_MAX_LINE_WIDTH = 160


def render(diagnostic: Diagnostic) -> str:
    """Return the headline, the source line with carets below it, both again for each label, and the hint."""
    out = [headline(diagnostic), *_excerpt(diagnostic.span)]
    for label in diagnostic.labels:
        out += [f"{label.span.place}: note: {label.text}", *_excerpt(label.span)]
    if diagnostic.hint:
        out.append(f"  hint: {diagnostic.hint}")
    return "\n".join(out)


def _excerpt(span: Span) -> list[str]:
    """Return the source line of a span, with carets below it; nothing for an empty line."""
    line, column = span.source.position(span.start)
    text = span.source.line(line)
    width = min(max(span.end - span.start, 1), max(len(text) - column + 1, 1))
    if len(text) > _MAX_LINE_WIDTH:
        left = max(0, column - 1 - _MAX_LINE_WIDTH // 2)
        text = text[left : left + _MAX_LINE_WIDTH]
        column -= left
        width = min(width, max(len(text) - column + 1, 1))
    shown = "".join(c if c.isprintable() else " " for c in text)
    if not shown.strip():
        return []
    number = str(line)
    return [f"  {number} | {shown}", f"  {' ' * len(number)} | {' ' * (column - 1)}{'^' * width}"]


def to_rows(diagnostics: Sequence[Diagnostic]) -> list[dict[str, object]]:
    """Return one JSON object per diagnostic, with 1-based lines and columns."""
    rows: list[dict[str, object]] = []
    for d in diagnostics:
        row = _row(d.span)
        row |= {"severity": d.severity, "code": d.code, "message": d.message, "hint": d.hint}
        row["labels"] = [{**_row(label.span), "message": label.text} for label in d.labels]
        rows.append(row)
    return rows


def _row(span: Span) -> dict[str, object]:
    line, column = span.source.position(span.start)
    end_line, end_column = span.source.position(span.end)
    row: dict[str, object] = {"file": span.source.name, "line": line, "column": column}
    return row | {"end_line": end_line, "end_column": end_column}


def to_json(diagnostics: Sequence[Diagnostic]) -> str:
    """Return a JSON array of `to_rows`."""
    import json

    return json.dumps(to_rows(diagnostics), indent=2)


def has_errors(diagnostics: Iterable[Diagnostic]) -> bool:
    """Return True if any diagnostic is an error."""
    return any(d.severity == "error" for d in diagnostics)


def in_order(diagnostics: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Sort by file (in order of first occurrence) and position, and drop duplicates."""
    files: dict[int, int] = {}
    unique: dict[tuple[object, ...], Diagnostic] = {}
    for d in diagnostics:
        file_index = files.setdefault(id(d.span.source), len(files))
        unique.setdefault((file_index, d.span.start, d.code, d.message, d.labels), d)
    return tuple(unique[key] for key in sorted(unique, key=lambda k: (k[0], k[1])))
