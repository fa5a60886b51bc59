"""Loads the text of a map from its file, and reports files that are missing or not text.

A file `*.yaml` or `*.yml` is an occupancy grid, any other one a StickRep map.
"""

from __future__ import annotations

import errno
import os

from colony.files import read_file, reason, size_text
from colony.shipped import Shipped
from colony.text.diagnostics import Diagnostic, DiagnosticError, error
from colony.text.source import Source, Span

MAX_BYTES = 4_000_000
GRID_SUFFIXES = (".yaml", ".yml")
IMAGE_SUFFIXES = (".pgm", ".png", ".bmp")
"""Suffixes of the images of occupancy grids."""


def is_grid(path: str | os.PathLike[str]) -> bool:
    """Return True if the name of a map's file is that of an occupancy grid."""
    return os.path.splitext(path)[1].lower() in GRID_SUFFIXES


def no_building(path: str | os.PathLike[str], purpose: str | None = None) -> Diagnostic:
    """Return the error for an occupancy grid where a building is needed, for a purpose if there is one."""
    needed = "expected a building" if purpose is None else f"{purpose} requires a building"
    message = f"{needed}; found an occupancy grid, which has neither rooms nor lights"
    hint = f"give a StickRep map: {', '.join(Shipped.MAP.names('.stickrep'))}"
    return error("M037", Span(Source(os.fspath(path), ""), 0, 0), message, hint)


def load_building_source(path: str | os.PathLike[str]) -> Source:
    """Load the text of the StickRep map at `path`.

    Raises:
        DiagnosticError: the file is an occupancy grid, cannot be read, is too large, or is not text.
    """
    if is_grid(path):
        raise DiagnosticError([no_building(path)])
    return load_source(path)


def load_source(path: str | os.PathLike[str], max_bytes: int = MAX_BYTES) -> Source:
    """Load the text of the file at `path`, of at most `max_bytes` bytes.

    Raises:
        DiagnosticError: the file cannot be read, is too large, or is not text.
    """
    shown = os.fspath(path)
    empty = Source(shown, "")
    try:
        data = read_file(path, max_bytes)
    except OSError as failure:
        if failure.errno == errno.EFBIG:
            message = f"the file is larger than {size_text(max_bytes)}; expected a map"
            span, hint = Span(empty, 0, 0), _image_hint(shown) or "did you mean another file?"
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
        hint = _image_hint(shown) or "save the file as UTF-8 text"
        raise DiagnosticError([error("M002", span, message, hint)]) from None


def _image_hint(path: str) -> str | None:
    """Return a hint for the image of a grid, given in place of its YAML file; None for another file."""
    is_image = os.path.splitext(path)[1].lower() in IMAGE_SUFFIXES
    return "this is an image: give the YAML file of the occupancy grid" if is_image else None
