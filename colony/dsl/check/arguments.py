"""Arguments of functions: expressions of the caller that stand in the place of parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from colony.dsl.check.compatibility import without_wildcard
from colony.dsl.check.scope import ArgumentSymbol
from colony.ir import expression as ir
from colony.ir.types import BOOL, Quantity, Type, element_type, in_shape_of
from colony.text.source import Span

_PLACEHOLDER = "(parameter)"
"""Name of the value of a parameter in the declaration of its function; no such expression is in a program."""


def placeholder(type_: Type, span: Span) -> ir.Expression:
    """Return what a parameter is in the declaration of its function."""
    return ir.DerivedValue(type=type_, name=_PLACEHOLDER, span=span)


def reads_placeholder(expression: ir.Expression) -> bool:
    """Return True if an expression reads a parameter that has no argument yet.

    Call it only for expressions in declarations of functions.
    """
    return any(
        isinstance(e, ir.DerivedValue) and e.name == _PLACEHOLDER for e in ir.subexpressions(expression)
    )


def argument_symbol(expression: ir.Expression, type_: Type | None, nodes: int) -> ArgumentSymbol:
    """Return the symbol of a parameter with this argument.

    Args:
        expression: the argument, which fits the parameter.
        type_: the type of the parameter; None for an array of any length.
        nodes: the number of nodes that were checked for the argument.
    """
    expression = expression if type_ is None else as_declared(expression, type_)
    depth, iterations, loops, has_memory = 1, 1, set[str](), False
    stack = [(expression, 1, 1)]
    while stack:
        node, level, rounds = stack.pop()
        depth, iterations = max(depth, level), max(iterations, rounds)
        match node:
            case ir.LoopIndex(name=name) | ir.LoopElement(name=name):
                loops.add(name)
            case ir.Reduce(variable=variable, low=low, high=high, arrays=arrays):
                loops.update((variable, *[name for name, _ in arrays]))
                rounds *= max(high - low + 1, 1)
            case ir.MemoryCall():
                has_memory = True
            case _:
                pass
        stack += [(child, level + 1, rounds) for child in ir.children(node)]
    return ArgumentSymbol(
        expression=expression,
        nodes=nodes,
        depth=depth,
        iterations=iterations,
        loops=frozenset(loops),
        has_memory=has_memory,
    )


def with_new_cells(expression: ir.Expression, new_cell: Callable[[], int]) -> ir.Expression:
    """Return an expression with other memory cells: no cell may be stepped twice in a frame."""
    if isinstance(expression, ir.MemoryCall):
        expression = replace(expression, cell=new_cell())
    return ir.rebuilt(expression, lambda part: with_new_cells(part, new_cell))


def as_declared(expression: ir.Expression, type_: Type) -> ir.Expression:
    """Return an expression with the type of its parameter or input: a literal 0 gets the dimension.

    An array keeps its size and bearings; `type_` may be that of an element.
    """
    return replace(expression, type=in_shape_of(element_type(type_), expression.type))


def without_wildcard_type(expression: ir.Expression) -> ir.Expression:
    """Return an expression with the type of a name for it: a lone literal 0 is a plain number."""
    element = element_type(expression.type)
    if isinstance(element, Quantity) and element.wildcard:
        return replace(expression, type=without_wildcard(expression.type))
    return expression


def freshness(expression: ir.Expression, span: Span) -> ir.Expression:
    """Return whether all that an expression needs is there: sensors themselves, and lets of files."""
    asked = dict.fromkeys(_needed(expression))
    parts = [ir.Fresh(type=BOOL, name=n, derived=derived, span=span) for n, derived in asked]
    if not parts:
        return ir.Constant(type=BOOL, value=True, span=span)
    if len(parts) == 1:
        return parts[0]
    return ir.Call(type=BOOL, function=ir.Function.ALL, arguments=tuple(parts), span=span)


def reads_parts(expression: ir.Expression) -> bool:
    """Return True if an argument needs lets of modules or fields sent, which can be missing in contracts."""
    return any(isinstance(e, ir.LocalValue | ir.SentField) for e in _needed_nodes(expression))


def _needed(expression: ir.Expression) -> Iterator[tuple[str, bool]]:
    for node in _needed_nodes(expression):
        if isinstance(node, ir.SensorValue | ir.DerivedValue):
            yield node.name, isinstance(node, ir.DerivedValue)


def _needed_nodes(expression: ir.Expression) -> Iterator[ir.Expression]:
    """Yield the subexpressions without any of which an expression is missing, in the order written."""
    stack = [expression]
    while stack:
        node = stack.pop()
        yield node
        stack += (node.other,) if isinstance(node, ir.ValueOr) else reversed(ir.children(node))
