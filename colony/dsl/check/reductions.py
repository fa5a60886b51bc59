"""Checking of reductions: `function(body for k in low .. high)`, `function(body for r, a in array)`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from colony.dsl import ast
from colony.dsl.check.arrays import bearings_of
from colony.dsl.check.calls import reduction_result
from colony.dsl.check.checker import Checker
from colony.dsl.check.reserved import reject_reserved_name
from colony.ir import expression as ir
from colony.ir.types import BOOL, DIMENSIONLESS, Array, element_type

MAX_ITERATIONS = 4096

_REDUCTIONS = {function.value: function for function in ir.REDUCTIONS}


def check_comprehension(
    checker: Checker, node: ast.Comprehension | ast.ElementsComprehension
) -> ir.Expression | None:
    """Check a reduction of a body for each value of a variable, or for each element of an array."""
    function = _REDUCTIONS.get(node.function.text)
    if function is None:
        hint = f"the reductions are {', '.join(sorted(_REDUCTIONS))}"
        checker.error("E211", node.function, f"`{node.function.text}` is not a reduction", hint)
        return None
    if isinstance(node, ast.Comprehension):
        rounds = _range_rounds(checker, node)
    else:
        rounds = _array_rounds(checker, node)
    return None if rounds is None else _comprehension(checker, node, function, rounds)


class _Rounds(NamedTuple):
    """The rounds of a reduction: its variable and bounds, what each name in its body is, and its arrays."""

    variable: str
    low: int
    high: int
    names: Mapping[str, ir.LoopIndex | ir.LoopElement]
    arrays: tuple[tuple[str, ir.Expression], ...] = ()


def _range_rounds(checker: Checker, node: ast.Comprehension) -> _Rounds | None:
    """Return the rounds of `for k in low .. high`."""
    low = checker.whole(node.low, "the start of a reduction", -(10**9), 10**9)
    high = checker.whole(node.high, "the end of a reduction", -(10**9), 10**9)
    if low is None or high is None:
        return None
    index = ir.LoopIndex(type=DIMENSIONLESS, name=_unique(checker, node.variable))
    return _Rounds(index.name, low, high, {node.variable.text: index})


def _array_rounds(checker: Checker, node: ast.ElementsComprehension) -> _Rounds | None:
    """Return the rounds of `for r in array`, or of `for r, a in array` with bearings."""
    array = checker.array(node.array)
    if array is None:
        return None
    arrays = [(node.variable, array)]
    if node.bearing is not None:
        bearings = bearings_of(checker, node.array, array)
        if bearings is None:
            return None
        if node.bearing.text == node.variable.text:
            message = f"`{node.bearing.text}` names both the element and its bearing"
            checker.error("E102", node.bearing, message, "choose two names")
            return None
        arrays.append((node.bearing, bearings))
    assert isinstance(array.type, Array)
    named = {name.text: (_unique(checker, name), values) for name, values in arrays}
    return _Rounds(
        named[node.variable.text][0],
        0,
        array.type.size - 1,
        {n: ir.LoopElement(type=element_type(v.type), name=unique) for n, (unique, v) in named.items()},
        tuple(named.values()),
    )


def _unique(checker: Checker, name: ast.Name) -> str:
    """Return a name for a variable of a reduction that differs from all around it."""
    reject_reserved_name(checker.report, checker.scope, name)
    taken = checker.taken_names
    unique, count = name.text, len(taken)
    while unique in taken:
        unique, count = f"{name.text}'{count}", count + 1
    return unique


def _comprehension(
    checker: Checker,
    node: ast.Comprehension | ast.ElementsComprehension,
    function: ir.Function,
    rounds: _Rounds,
) -> ir.Expression | None:
    iterations = checker.iterations * max(rounds.high - rounds.low + 1, 1)
    if iterations > MAX_ITERATIONS:
        checker.error("E211", node, f"{iterations} iterations; at most {MAX_ITERATIONS} are allowed")
        return None
    inner = replace(checker, loops={**checker.loops, **rounds.names}, iterations=iterations)
    body = inner.visit(node.body)
    condition = (
        None if node.condition is None else inner.expect(node.condition, BOOL, "the `if` of a reduction")
    )
    if body is None or (condition is None and node.condition is not None):
        return None
    if isinstance(body.type, Array):
        checker.error(
            "E211", node.body, "the body of a reduction must be a scalar", "reduce the array inside it"
        )
        return None
    result = reduction_result(checker, node, node.function, function, [body.type])
    if result is None:
        return None
    return ir.Reduce(
        type=result,
        function=function,
        variable=rounds.variable,
        low=rounds.low,
        high=rounds.high,
        body=body,
        condition=condition,
        arrays=rounds.arrays,
        span=checker.span(node),
    )
