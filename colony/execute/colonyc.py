"""A compiled program as bytes: in a file `*.colonyc`, and for the processes that run its clients.

    "colonyc", the version of the format and that of the semantics in one byte each, the SHA-256 of the rest,
    the rest in MessagePack

The format says how a program is laid out, the semantics (`colony.ir.version`) what it decides. Reading a
file executes none of it, and checks all of it: size, versions and checksum, then each value against its type
(`shapes`), then each reference (`validity`). A damaged or forged program is rejected with C001.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import cache, reduce
from hashlib import sha256
from operator import or_
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta

from colony.execute.compiled import Compiled
from colony.execute.validity import InvalidProgramError, check
from colony.files import COMPILED, StrPath, open_regular, read_file, reason
from colony.ir.version import SEMANTICS, semantics_mismatch
from colony.text.diagnostics import Diagnostic, DiagnosticError, error
from colony.text.source import NOWHERE, Source, Span

# --- shapes -------------------------------------------------------------------------------------------
#
# Data classes as MessagePack, checked by msgspec.
#
# Shapes are derived from the classes: an object becomes an array that begins with the name of its class, so
# that unions are tagged. A `Span` becomes a `SpanShape`.

MAX_ITEMS = 500_000
"""Maximum length of a tuple or mapping, checked before its items are read."""


class SpanShape(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """A span: the index of its source, None if it is in no source, with its start and end."""

    source: int | None
    start: int
    end: int


_CLASSES: dict[type, type] = {}
"""Data class of each shape."""


def shape(hint: Any) -> Any:
    """Return the type that msgspec checks in place of a type hint."""
    if hint is Span:
        return SpanShape
    if is_dataclass(hint):
        cls: Any = hint
        return _of_class(cls)
    origin: Any = get_origin(hint)
    if origin is None or origin is Literal:
        return hint
    arguments = tuple(map(shape, get_args(hint)))
    if origin is UnionType:
        return reduce(or_, arguments)
    is_variadic = origin is dict or Ellipsis in arguments
    return Annotated[origin[arguments], Meta(max_length=MAX_ITEMS)] if is_variadic else origin[arguments]


@cache
def _of_class(cls: Any) -> Any:
    hints = get_type_hints(cls)
    members = [(f.name, shape(hints[f.name])) for f in fields(cls)]
    struct = msgspec.defstruct(
        cls.__name__,
        members,
        frozen=True,
        array_like=True,
        forbid_unknown_fields=True,
        tag=True,
        tag_field="",
    )
    _CLASSES[struct] = cls
    return struct


def to_shape(value: Any, span_shape: Callable[[Span], SpanShape]) -> Any:
    """Convert a value to its shape; `span_shape` converts spans."""
    if isinstance(value, Span):
        return span_shape(value)
    if is_dataclass(value):
        cls: Any = type(value)
        struct = _of_class(cls)
        return struct(*[to_shape(getattr(value, name), span_shape) for name in struct.__struct_fields__])
    return tuple([to_shape(element, span_shape) for element in value]) if type(value) is tuple else value


def from_shape(value: Any, span: Callable[[SpanShape], Span]) -> Any:
    """Convert a shape back to its value; `span` converts spans."""
    if isinstance(value, SpanShape):
        return span(value)
    if isinstance(value, msgspec.Struct):
        cls = _CLASSES[type(value)]
        return cls(**{name: from_shape(getattr(value, name), span) for name in value.__struct_fields__})
    return tuple([from_shape(element, span) for element in value]) if type(value) is tuple else value


# --- colonyc ------------------------------------------------------------------------------------------

VERSION = 10
"""Version of the format. Shapes derive from data classes: increment it with each change of one."""

SUFFIX = ".colonyc"
"""Suffix of a file that holds a compiled program."""

MAX_BYTES = 16 * 1024 * 1024
"""Maximum size in bytes of a compiled program, many times the size of one with ten thousand modules."""

_HINT = "create one with `colony compile FILE -o NAME.colonyc`"
_PREFIX = COMPILED + bytes([VERSION, SEMANTICS])
_HEADER_SIZE = len(_PREFIX) + sha256().digest_size
_decoder: msgspec.msgpack.Decoder[Any] = msgspec.msgpack.Decoder(shape(Compiled))


def encode(compiled: Compiled) -> bytes:
    """Return a compiled program as bytes, without spans outside its sources."""
    numbers = {s.data.decode(): i for i, s in enumerate(compiled.sources) if s.kind == "behavior"}

    def span_shape(span: Span) -> SpanShape:
        return SpanShape(numbers.get(span.source.text), span.start, span.end)

    body = msgspec.msgpack.encode(to_shape(compiled, span_shape))
    return _PREFIX + sha256(body).digest() + body


def decode(data: bytes, name: str) -> Compiled:
    """Return the compiled program in `data`; messages name it `name`.

    Raises:
        DiagnosticError: C001, it is not a valid compiled program.
    """
    try:
        return _decode(data)
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


def _decode(data: bytes) -> Compiled:
    if not data.startswith(COMPILED):
        raise InvalidProgramError("it does not begin with the header of a compiled program")
    if not data.startswith(_PREFIX):
        found = [*data[len(COMPILED) : len(_PREFIX)], 0, 0]
        if found[0] != VERSION:
            raise InvalidProgramError(
                f"its format is version {found[0]}, this colony reads version {VERSION}; compile it again"
            )
        raise InvalidProgramError(f"it {semantics_mismatch(found[1])}; compile it again")
    body = memoryview(data)[_HEADER_SIZE:]
    if sha256(body).digest() != data[len(_PREFIX) : _HEADER_SIZE]:
        raise InvalidProgramError("it is damaged: its checksum does not match")
    read = _decoder.decode(body)
    texts = [
        Source(source.path, source.data.decode() if source.kind == "behavior" else "")
        for source in read.sources
    ]

    def span(shape: SpanShape) -> Span:
        if shape.source is None:
            return NOWHERE
        if not (
            0 <= shape.source < len(texts) and 0 <= shape.start <= shape.end <= len(texts[shape.source].text)
        ):
            raise InvalidProgramError("a span is outside its source")
        return Span(texts[shape.source], shape.start, shape.end)

    compiled: Compiled = from_shape(read, span)
    check(compiled)
    return compiled


def unusable(name: str, message: str) -> Diagnostic:
    """Return the diagnostic C001 for the file `name`; `message` gives the reason."""
    span = Span(Source(name, ""), 0, 0)
    return error("C001", span, f"not a valid compiled program: {message}", _HINT)
