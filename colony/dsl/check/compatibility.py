"""Type compatibility, and the wording of types in messages."""

from __future__ import annotations

from collections.abc import Iterable

from colony.ir.types import (
    DIMENSIONLESS,
    Array,
    Bool,
    Enum,
    Quantity,
    Scalar,
    Type,
    element_type,
    in_shape_of,
    is_percent,
    type_text,
)
from colony.text.wording import listed


def unify(a: Scalar, b: Scalar) -> Scalar | None:
    """Return the common type of two scalars, or None; a literal 0 fits any dimension, others no percent."""
    if isinstance(a, Quantity) and isinstance(b, Quantity):
        if a.wildcard:
            return b
        if b.wildcard:
            return a
        if a.dimension != b.dimension or {a.written, b.written} == {"percent", "literal"}:
            return None
        return b if a.written == "literal" or b.written == "percent" else a
    return a if a == b else None


def fits(found: Type, expected: Type) -> bool:
    """Return True if a value of type `found` can be used where `expected` is declared."""
    if isinstance(found, Array) != isinstance(expected, Array):
        return False
    if isinstance(found, Array) and isinstance(expected, Array) and found.size != expected.size:
        return False
    return unify(element_type(found), element_type(expected)) is not None


def without_wildcard(type_: Type) -> Type:
    """Return the type of a name whose value has this type: a lone literal 0 is a plain number."""
    element = element_type(type_)
    return in_shape_of(DIMENSIONLESS, type_) if isinstance(element, Quantity) and element.wildcard else type_


def with_article(type_: Type) -> str:
    """Return the name of a type with its article, for messages."""
    if isinstance(type_, Array):
        return f"an array of {type_.size} {plural(type_.element)}"
    if isinstance(type_, Bool):
        return "a bool"
    if isinstance(type_, Enum):
        return f"a phase of `{type_.name}`" if type_.kind == "machine" else f"a `{type_.name}`"
    if type_.dimension == DIMENSIONLESS.dimension and not is_percent(type_):
        return "a plain number"
    return f"a value in {type_text(type_)}"


def plural(type_: Scalar) -> str:
    """Return the name of several values of a type, for messages."""
    if isinstance(type_, Bool):
        return "bools"
    if isinstance(type_, Enum):
        return f"phases of `{type_.name}`" if type_.kind == "machine" else f"`{type_.name}` values"
    if type_.dimension == DIMENSIONLESS.dimension and not is_percent(type_):
        return "plain numbers"
    return f"values in {type_text(type_)}"


def with_articles(types: Iterable[Type]) -> str:
    """Return the names of types with their articles, listed as in a sentence."""
    return listed([with_article(t) for t in types])
