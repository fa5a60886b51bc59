"""Loads the text of a StickRep map from its file, and reports files that are missing or not text."""

from __future__ import annotations

import errno
import os

from colony.files import read_file, reason
from colony.shipped import Shipped
from colony.text.diagnostics import DiagnosticError, error
from colony.text.source import Source, Span

MAX_BYTES = 4_000_000


def load_source(path: str | os.PathLike[str]) -> Source:
    """Load the text of the file at `path`.

    Raises:
        DiagnosticError: the file cannot be read, is too large, or is not text.
    """
    shown = os.fspath(path)
    empty = Source(shown, "")
    try:
        data = read_file(path, MAX_BYTES)
    except OSError as failure:
        if failure.errno == errno.EFBIG:
            message = f"the file is larger than {MAX_BYTES // 1_000_000} MB; expected a map"
            span, hint = Span(empty, 0, 0), "did you mean another file?"
            raise DiagnosticError([error("M002", span, message, hint)]) from None
        message = f"cannot read the map: {reason(failure)}"
        suggestion = Shipped.MAP.hint(shown) if failure.errno == errno.ENOENT else None
        raise DiagnosticError([error("M001", Span(empty, 0, 0), message, suggestion)]) from None
    try:
        return Source(shown, data.decode("utf-8-sig"))
    except UnicodeDecodeError as failure:
        valid = Source(shown, data[: failure.start].decode("utf-8", "replace"))
        message = f"byte 0x{data[failure.start]:02x} is not UTF-8 text; expected a map"
        span = Span(valid, len(valid.text), len(valid.text))
        raise DiagnosticError([error("M002", span, message, "save the file as UTF-8 text")]) from None
