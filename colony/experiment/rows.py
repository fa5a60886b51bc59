"""Results as rows of a table, whose columns follow from the fields of the class.

A string or a number has its own column, and so has each part of a named tuple, of a tuple of known length,
and of a mapping with known keys. Any other value is JSON text, except points, which are packed.
"""

from __future__ import annotations

import json
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from itertools import chain
from operator import getitem
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import msgspec

Points = Annotated[tuple[tuple[int, int], ...], "packed"]
"""Points, x and y in mm, stored as 32-bit integers."""

_SQL = {str: "TEXT", int: "INTEGER", bool: "INTEGER", float: "REAL", Points: "BLOB"}


def sql_types_of(kind: Any) -> list[str]:
    """Return the SQL types of the columns of a class."""
    parts = _parts(kind)
    if parts is None:
        return [_SQL.get(kind, "TEXT")]
    return [name for part in parts.values() for name in sql_types_of(part)]


def row_of(kind: Any, value: Any) -> list[object]:
    """Return a result of this class as a row."""
    parts = _parts(kind)
    if parts is None:
        return [_cell(kind, value)]
    get = getattr if get_origin(kind) is None else getitem
    return [cell for key, part in parts.items() for cell in row_of(part, get(value, key))]


def result_of(kind: Any, cells: Iterator[Any]) -> Any:
    """Return a result of this class from the cells of a row."""
    parts = _parts(kind)
    if parts is None:
        return _value(kind, next(cells))
    values = {key: result_of(part, cells) for key, part in parts.items()}
    if get_origin(kind) is None:
        return kind(**values)
    return tuple(values.values()) if get_origin(kind) is tuple else values


def _parts(kind: Any) -> dict[Any, Any] | None:
    """Return the types of the parts with own columns, by name, index or key; None for a single column."""
    origin, arguments = get_origin(kind), get_args(kind)
    if is_dataclass(kind) or hasattr(kind, "_fields"):
        return get_type_hints(kind, include_extras=True)
    if origin is tuple and Ellipsis not in arguments:
        return dict(enumerate(arguments))
    if origin is Mapping and get_origin(arguments[0]) is Literal:
        return dict.fromkeys(get_args(arguments[0]), arguments[1])
    return None


def _cell(kind: Any, value: Any) -> object:
    if kind is Points:
        return array("i", chain.from_iterable(value)).tobytes()
    return value if isinstance(value, str | int | float) else json.dumps(value)


def _value(kind: Any, cell: Any) -> object:
    if kind is Points:
        numbers = array("i", cell)
        return tuple(zip(numbers[0::2], numbers[1::2], strict=True))
    if kind is bool:
        return bool(cell)
    return msgspec.convert(json.loads(cell) if get_origin(kind) in (tuple, Mapping) else cell, kind)
