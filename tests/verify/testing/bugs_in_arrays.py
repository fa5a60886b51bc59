"""Mistakes in the lowering of elements of arrays."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from colony.compile.lower import expressions
from colony.compile.lower.expressions import ExpressionLowering
from colony.ir.bearings import Bearings, Lookup, lookup
from tests.verify.testing.bugs_in_passes import Plant


def arrays(method: str, change: Callable[..., Any]) -> Plant:
    """`change` a method of the lowering of expressions, which gets the original and its arguments."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        original = getattr(ExpressionLowering, method)
        monkeypatch.setattr(ExpressionLowering, method, lambda *args: change(original, *args))

    return plant


def looked_up(change: Callable[[Bearings], Lookup]) -> Plant:
    """`change` how the element along an angle is looked up."""
    return lambda monkeypatch: monkeypatch.setattr(expressions, "lookup", change)


def always_wrapped(original: Any, lowering: Any, e: Any, *rest: Any) -> int:
    """Indices of all arrays wrap."""
    return original(lowering, replace(e, wraps=True), *rest)  # type: ignore[no-any-return]


def never_wrapped(original: Any, lowering: Any, e: Any, *rest: Any) -> int:
    """Indices of rings do not wrap either."""
    return original(lowering, replace(e, wraps=False), *rest)  # type: ignore[no-any-return]


def always_found(original: Any, lowering: Any, *rest: Any) -> tuple[int, int]:
    """`value_or` of an element that is outside is that element."""
    value, _ = original(lowering, *rest)
    return value, lowering.builder.literal(0.0)


def higher_of_two(bearings: Bearings) -> Lookup:
    """Of two elements that are equally near it is the next one."""
    table = lookup(bearings)
    return replace(table, breaks=tuple(math.nextafter(b, -math.inf) for b in table.breaks))


def never_outside(bearings: Bearings) -> Lookup:
    """Beyond its ends, an arc goes on with its last element."""
    table = lookup(bearings)
    last = next(i for i in table.indices[::-1] if i is not None)
    return replace(table, indices=tuple(last if i is None else i for i in table.indices))
