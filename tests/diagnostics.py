"""What is wrong with a text or a file, as the exception of its reader lists it."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from colony.text.diagnostics import Diagnostic, DiagnosticError


def problems_of(read: Callable[..., object], *arguments: object, **options: object) -> tuple[Diagnostic, ...]:
    """Return the diagnostics with which a call refuses its arguments."""
    with pytest.raises(DiagnosticError) as caught:
        read(*arguments, **options)
    return tuple(caught.value.diagnostics)


def place_of(found: Diagnostic) -> str:
    """Return the line and column of a diagnostic."""
    line, column = found.span.source.position(found.span.start)
    return f"{line}:{column}"
