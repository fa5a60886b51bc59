"""The table of all keys of a body, as docs/robots.md has it: `python -m tests.body.keys_table` prints it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

from colony.body.kinds import (
    AnyAmount,
    FixedArray,
    Flag,
    FreeKeys,
    Interval,
    Kind,
    Many,
    Measure,
    NamedTables,
    OneOf,
    TableKind,
    TextKind,
    Whole,
    WordKind,
    entries,
)
from colony.body.model import ROOT


def rows() -> list[str]:
    """The rows: the table, the key, a value, and the meaning."""
    found = dict.fromkeys(f"| {' | '.join(cells)} |" for cells in _rows(ROOT.type, ""))
    return ["| in | key | value | meaning |", "|---|---|---|---|", *found]


def _rows(type_: type, table: str) -> Iterator[tuple[str, str, str, str]]:
    inner: list[tuple[type, str]] = []
    for e in entries(type_):
        path = f"{table}.{e.key}".strip(".").replace("`, `proximity", "")
        match e.kind:
            case TableKind(type=below):
                inner.append((below, path))
            case NamedTables(item=TableKind(type=below)):
                inner.append((below, f"{path}.NAME"))
            case NamedTables(item=item):
                needed = "" if "[default" in e.meaning else " (optional)"
                yield f"`{path}`", "any name", _value(item), e.meaning + needed
            case OneOf(types=types):
                for name, below in types:
                    yield (
                        f"`{path}`",
                        f"`{e.kind.tag}`",
                        f'`"{name}"`',
                        (below.__doc__ or "").partition("\n")[0],
                    )
                    inner.append((below, f"{path}`, `{name}"))
            case FreeKeys():
                yield f"`{table}`", "any other", "a text, a number or a bool", e.meaning
            case _:
                needed = "" if e.is_required or "[default" in e.meaning else " (optional)"
                yield f"`{table}`", f"`{e.key}`", _value(e.kind), e.meaning + needed
    for below, path in inner:
        yield from _rows(below, path)


def _value(kind: Kind) -> str:
    match kind:
        case Measure() | Interval() | AnyAmount():
            return f'`"{kind.example}"`'
        case Whole():
            return "whole number"
        case WordKind():
            return " or ".join(f'`"{word}"`' for word in kind.words)
        case Flag():
            return "true or false"
        case TextKind():
            return kind.form
        case Many():
            return f"array, each {_value(kind.item)}"
        case FixedArray():
            return "`[" + ", ".join(_value(item).strip("`") for item in kind.items) + "]`"
        case TableKind() | OneOf() | NamedTables() | FreeKeys():
            raise AssertionError("a table is no value")
        case _:
            assert_never(kind)


if __name__ == "__main__":
    print("\n".join(rows()))
