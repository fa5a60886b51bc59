"""Data classes as MessagePack, checked by msgspec.

Shapes are derived from the classes: an object becomes an array that begins with the name of its class, so
that unions are tagged. A `Span` becomes a `SpanShape`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import cache, reduce
from operator import or_
from types import UnionType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta

from colony.text.source import Span

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
