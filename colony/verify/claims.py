"""Constructors for the contract expressions that proofs are about."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import reduce

from colony.ir import expression as ir
from colony.ir.expression import Binary, Expression
from colony.ir.types import BOOL, Array, Scalar, ScalarValue
from colony.text.wording import one_line

# --- source text ---------------------------------------------------------------------------------------
#
# The source text of expressions.


_COMMENT = re.compile(r"#[^\r\n]*")


def source_text(expression: Expression) -> str:
    """Return the text of an expression on one line, without comments.

    The span of `a and (b)` ends with `b`: parentheses cut off at either end are put back.
    """
    text = one_line(_COMMENT.sub("", expression.span.text))
    depth = deepest = 0
    for c in text:
        depth += (c == "(") - (c == ")")
        deepest = min(deepest, depth)
    return "(" * -deepest + text + ")" * (depth - deepest)


# --- claims --------------------------------------------------------------------------------------------


FALSE = ir.Constant(type=BOOL, value=False)
TRUE = ir.Constant(type=BOOL, value=True)


def active(name: str) -> ir.Expression:
    """Return the expression "`name`, a module or wire, has an active output"."""
    return ir.IsActive(type=BOOL, name=name)


def won(actuator: str, module: str) -> ir.Expression:
    """Return the expression "`module` wins `actuator`"."""
    return ir.WonBy(type=BOOL, actuator=actuator, module=module)


def fresh(sensor: str) -> ir.Expression:
    """Return the expression "`sensor` is fresh"."""
    return ir.Fresh(type=BOOL, name=sensor, derived=False)


def constant(value: ScalarValue, type_: Scalar) -> ir.Expression:
    """Return a constant expression."""
    return ir.Constant(type=type_, value=value)


def value_or(e: ir.Expression, other: ir.Expression) -> ir.Expression:
    """Return `e`, or `other` where `e` reads something missing."""
    return ir.ValueOr(type=e.type, expression=e, other=other)


def negation(e: ir.Expression) -> ir.Expression:
    """Return the negation of an expression."""
    return ir.UnaryOperation(type=BOOL, operator=ir.Unary.NOT, operand=e)


def binary(operator: Binary, left: ir.Expression, right: ir.Expression) -> ir.Expression:
    """Return an operation whose result is a bool."""
    return ir.BinaryOperation(type=BOOL, operator=operator, left=left, right=right)


def present(x: ir.Expression) -> ir.Expression:
    """Return a bool that is missing where `x` is: `x == x`, of all elements."""
    if isinstance(x.type, Array):
        same = ir.BinaryOperation(
            type=Array(BOOL, x.type.size), operator=Binary.EQUAL, left=x, right=x, span=x.span
        )
        return ir.FunctionCall(type=BOOL, function=ir.Function.ALL, arguments=(same,), span=x.span)
    return binary(Binary.EQUAL, x, x)


def implies(left: ir.Expression, right: ir.Expression) -> ir.Expression:
    """Return the expression "`left` implies `right`"."""
    return binary(Binary.IMPLIES, left, right)


def all_of(operands: Iterable[ir.Expression]) -> ir.Expression:
    """Return the conjunction of expressions."""
    return _join(Binary.AND, list(operands), TRUE)


def any_of(operands: Iterable[ir.Expression]) -> ir.Expression:
    """Return the disjunction of expressions."""
    return _join(Binary.OR, list(operands), FALSE)


def _join(operator: Binary, operands: Sequence[ir.Expression], empty: ir.Expression) -> ir.Expression:
    return reduce(lambda a, b: binary(operator, a, b), operands) if operands else empty
