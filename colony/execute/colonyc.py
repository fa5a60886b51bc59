"""A compiled program as bytes: in a file `*.colonyc`, and for the processes that run its clients.

    "colonyc", one byte of version, the SHA-256 of the rest, the rest in MessagePack

Reading it executes nothing, and checks everything: size, version and checksum, then each value against its
type (`shapes`), then each reference (`validity`). A damaged or forged program is refused with C001.
"""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path
from typing import Any

import msgspec

from colony.execute.compiled import Compiled
from colony.execute.shapes import SpanShape, restored, shape, shaped
from colony.execute.validity import InvalidProgramError, check
from colony.files import COMPILED, StrPath, open_regular, read_file, reason
from colony.text.diagnostics import Diagnostic, DiagnosticError, error
from colony.text.source import NOWHERE, Source, Span

VERSION = 1
"""Version of the format. Shapes derive from data classes: increment it with each change of one."""

SUFFIX = ".colonyc"
"""Suffix of a file that holds a compiled program."""

MAX_BYTES = 16 * 1024 * 1024
"""Maximum size of a compiled program: many times that of one with ten thousand modules."""

_HINT = "create one with `colony compile FILE -o NAME.colonyc`"
_PREFIX = COMPILED + bytes([VERSION])
_HEAD = len(_PREFIX) + sha256().digest_size
_decoder: msgspec.msgpack.Decoder[Any] = msgspec.msgpack.Decoder(shape(Compiled))


def encode(compiled: Compiled) -> bytes:
    """Return a compiled program as bytes. Spans outside its sources are left out."""
    numbers = {s.data.decode(): i for i, s in enumerate(compiled.sources) if s.kind == "behavior"}

    def place(span: Span) -> SpanShape:
        return SpanShape(numbers.get(span.source.text), span.start, span.end)

    body = msgspec.msgpack.encode(shaped(compiled, place))
    return _PREFIX + sha256(body).digest() + body


def decode(data: bytes, name: str) -> Compiled:
    """Return the compiled program in `data`; messages name it `name`.

    Raises:
        DiagnosticError: C001, it is not a valid compiled program.
    """
    try:
        return _decoded(data)
    except (msgspec.DecodeError, ValueError, RecursionError) as problem:
        raise DiagnosticError([unusable(name, str(problem) or type(problem).__name__)]) from None


def read(path: StrPath) -> Compiled:
    """Return the compiled program in a file.

    Raises:
        DiagnosticError: C001, the file cannot be read, or is not a valid compiled program.
    """
    try:
        data = read_file(path, MAX_BYTES)
    except OSError as problem:
        raise DiagnosticError([unusable(str(path), reason(problem))]) from None
    return decode(data, str(path))


def is_compiled(path: StrPath) -> bool:
    """Return True for a file with the header or the suffix of a compiled program."""
    if Path(path).suffix == SUFFIX:
        return True
    try:
        with open_regular(path) as file:
            return file.read(len(COMPILED)) == COMPILED
    except OSError:
        return False


def _decoded(data: bytes) -> Compiled:
    if not data.startswith(COMPILED):
        raise InvalidProgramError("it does not begin with the header of a compiled program")
    if not data.startswith(_PREFIX):
        raise InvalidProgramError(f"its format version is not {VERSION}; compile it again")
    body = memoryview(data)[_HEAD:]
    if sha256(body).digest() != data[len(_PREFIX) : _HEAD]:
        raise InvalidProgramError("it is damaged: its checksum does not match")
    read = _decoder.decode(body)
    texts = [
        Source(source.place, source.data.decode() if source.kind == "behavior" else "")
        for source in read.sources
    ]

    def span(place: SpanShape) -> Span:
        if place.source is None:
            return NOWHERE
        if not (
            0 <= place.source < len(texts) and 0 <= place.start <= place.end <= len(texts[place.source].text)
        ):
            raise InvalidProgramError("a span is outside its source")
        return Span(texts[place.source], place.start, place.end)

    compiled: Compiled = restored(read, span)
    check(compiled)
    return compiled


def unusable(name: str, message: str) -> Diagnostic:
    """Return the diagnostic C001 for the file `name`; `message` gives the reason."""
    place = Span(Source(name, ""), 0, 0)
    return error("C001", place, f"not a valid compiled program: {message}", _HINT)
