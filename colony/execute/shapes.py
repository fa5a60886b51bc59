"""Data classes as MessagePack, checked by msgspec.

Shapes derive from the classes: an object becomes an array that begins with the name of its class, so that
unions are tagged. A `Span` becomes a `SpanShape`.
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
"""Maximum number of items of one kind, checked before any of them is read."""


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
        of: Any = hint
        return _of_class(of)
    origin: Any = get_origin(hint)
    if origin is None or origin is Literal:
        return hint
    arguments = tuple(map(shape, get_args(hint)))
    if origin is UnionType:
        return reduce(or_, arguments)
    several = origin is dict or Ellipsis in arguments
    return Annotated[origin[arguments], Meta(max_length=MAX_ITEMS)] if several else origin[arguments]


@cache
def _of_class(of: Any) -> Any:
    hints = get_type_hints(of)
    members = [(f.name, shape(hints[f.name])) for f in fields(of)]
    made = msgspec.defstruct(
        of.__name__,
        members,
        frozen=True,
        array_like=True,
        forbid_unknown_fields=True,
        tag=True,
        tag_field="",
    )
    _CLASSES[made] = of
    return made


def shaped(value: Any, place: Callable[[Span], SpanShape]) -> Any:
    """Return a value in its shape; `place` converts spans."""
    if isinstance(value, Span):
        return place(value)
    if is_dataclass(value):
        of: Any = type(value)
        made = _of_class(of)
        return made(*[shaped(getattr(value, name), place) for name in made.__struct_fields__])
    return tuple([shaped(element, place) for element in value]) if type(value) is tuple else value


def restored(value: Any, span: Callable[[SpanShape], Span]) -> Any:
    """Return the value of a shape; `span` converts spans back."""
    if isinstance(value, SpanShape):
        return span(value)
    if isinstance(value, msgspec.Struct):
        made = _CLASSES[type(value)]
        return made(**{name: restored(getattr(value, name), span) for name in value.__struct_fields__})
    return tuple([restored(element, span) for element in value]) if type(value) is tuple else value
