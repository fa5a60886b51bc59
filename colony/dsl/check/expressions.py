"""Checking of expressions: resolve names, turn units into factors, and give each node its type."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from colony.dsl import ast
from colony.dsl.check.arrays import check_comprehension, check_index, check_slice
from colony.dsl.check.checker import Checker, percent_hint, unit_hint
from colony.dsl.check.compatibility import unify, unit_of, with_article, with_articles
from colony.dsl.check.functions import check_any_call
from colony.dsl.check.references import resolve_reference, resolve_status, resolve_winner
from colony.ir import expression as ir
from colony.ir.types import (
    BOOL,
    DIMENSIONLESS,
    LITERAL,
    ZERO,
    Bool,
    Enum,
    Quantity,
    Scalar,
    Type,
    element_type,
    in_unit,
)
from colony.text.units import common_units
from colony.text.wording import listed


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpressionChecker(Checker):
    """A checker of every kind of expression."""

    def visit(self, node: ast.Expression) -> ir.Expression | None:
        """Check a subexpression, whose depth `check` has checked."""
        size = self.report.size
        found = _CHECKS[type(node)](self, node) if size.enter_node() else None
        size.leave_node()
        return found

    def _boolean(self, node: ast.Boolean) -> ir.Expression:
        return ir.Constant(type=BOOL, value=node.value, span=self.span(node))

    def _number(self, node: ast.NumberNode) -> ir.Expression | None:
        value = self.literal(node, node.unit)
        if value is None:
            return None
        type_ = in_unit(unit_of(node.unit)) if node.unit else (LITERAL if value != 0 else ZERO)
        return ir.Constant(type=type_, value=value, span=self.span(node))

    def _prefix(self, node: ast.Prefix) -> ir.Expression | None:
        operand = self.visit(node.operand)
        if operand is None:
            return None
        element, span = element_type(operand.type), self.span(node)
        if node.operator == "not":
            if not isinstance(element, Bool):
                self.error("E201", node.operand, f"`not` needs a bool, found {with_article(operand.type)}")
                return None
            return ir.UnaryOperation(type=operand.type, operator=ir.Unary.NOT, operand=operand, span=span)
        if not isinstance(element, Quantity):
            self.error("E201", node.operand, f"`-` needs a number, found {with_article(operand.type)}")
            return None
        return ir.UnaryOperation(type=operand.type, operator=ir.Unary.NEGATE, operand=operand, span=span)

    def _infix(self, node: ast.Infix) -> ir.Expression | None:
        left, right = self.visit(node.left), self.visit(node.right)
        if left is None or right is None:
            return None
        operator = ir.Binary(node.operator)
        element = _result(operator, element_type(left.type), element_type(right.type))
        if element is None:
            self.error(
                "E201",
                node,
                _mismatch(operator, left.type, right.type),
                _infix_hint(node, operator, left.type, right.type),
            )
            return None
        type_ = self.broadcast(node, element, left.type, right.type)
        if type_ is None:
            return None
        return ir.BinaryOperation(type=type_, operator=operator, left=left, right=right, span=self.span(node))

    def _if(self, node: ast.If) -> ir.Expression | None:
        condition = self.visit(node.condition)
        yes, no = self.visit(node.yes), self.visit(node.no)
        if condition is not None and not isinstance(condition.type, Bool):
            found = with_article(condition.type)
            self.error("E202", node.condition, f"the condition of `if` must be a bool, found {found}")
            condition = None
        if condition is None or yes is None or no is None:
            return None
        element = unify(element_type(yes.type), element_type(no.type))
        if element is None:
            message = f"the branches of `if` differ: {with_article(yes.type)} and {with_article(no.type)}"
            self.error("E201", node, message, percent_hint((node.yes, yes.type), (node.no, no.type)))
            return None
        type_ = self.broadcast(node, element, yes.type, no.type)
        if type_ is None:
            return None
        return ir.Conditional(type=type_, condition=condition, yes=yes, no=no, span=self.span(node))

    def _in_range(self, node: ast.InRange) -> ir.Expression | None:
        nodes = (node.operand, node.low, node.high)
        parts = [self.visit(p) for p in nodes]
        operand, low, high = parts
        if operand is None or low is None or high is None:
            return None
        elements = [element_type(p.type) for p in (operand, low, high)]
        common = unify(elements[0], elements[1])
        if common is None or unify(common, elements[2]) is None or not isinstance(common, Quantity):
            types = [p.type for p in (operand, low, high)]
            shown, hint = with_articles(types), percent_hint(*zip(nodes, types, strict=True))
            self.error("E201", node, f"`in` needs three numbers of one dimension, found {shown}", hint)
            return None
        type_ = self.broadcast(node, BOOL, operand.type, low.type, high.type)
        if type_ is None:
            return None
        return ir.Within(type=type_, operand=operand, low=low, high=high, span=self.span(node))


_CHECKS: dict[type[ast.SyntaxNode], Callable[[ExpressionChecker, Any], ir.Expression | None]] = {
    ast.NumberNode: ExpressionChecker._number,
    ast.Boolean: ExpressionChecker._boolean,
    ast.Reference: resolve_reference,
    ast.Prefix: ExpressionChecker._prefix,
    ast.Infix: ExpressionChecker._infix,
    ast.If: ExpressionChecker._if,
    ast.InRange: ExpressionChecker._in_range,
    ast.IndexNode: check_index,
    ast.SliceOf: check_slice,
    ast.CallNode: check_any_call,
    ast.Comprehension: check_comprehension,
    ast.ElementsComprehension: check_comprehension,
    ast.By: resolve_winner,
    ast.Is: resolve_status,
}


# --- operators -------------------------------------------------------------------------------------

_BOOLEAN = frozenset({ir.Binary.AND, ir.Binary.OR, ir.Binary.IMPLIES})
_EQUALITY = frozenset({ir.Binary.EQUAL, ir.Binary.NOT_EQUAL})
_SUMS = frozenset({ir.Binary.ADD, ir.Binary.SUBTRACT})


def _result(operator: ir.Binary, a: Scalar, b: Scalar) -> Scalar | None:
    """Return the element type of an operation, or None if its operands have the wrong types."""
    if operator in _BOOLEAN:
        return BOOL if isinstance(a, Bool) and isinstance(b, Bool) else None
    if operator in _EQUALITY:
        return None if unify(a, b) is None else BOOL
    if not isinstance(a, Quantity) or not isinstance(b, Quantity):
        return None
    if operator is ir.Binary.MULTIPLY:
        return Quantity(a.dimension.times(b.dimension))
    if operator is ir.Binary.DIVIDE:
        return Quantity(a.dimension.over(b.dimension))
    common = unify(a, b)
    return common if common is None or operator in _SUMS else BOOL


def _mismatch(operator: ir.Binary, a: Type, b: Type) -> str:
    expected = "two bools" if operator in _BOOLEAN else "two values of one type"
    if operator in _SUMS or (operator not in _BOOLEAN and operator not in _EQUALITY):
        expected = "two numbers of one dimension"
    if operator in (ir.Binary.MULTIPLY, ir.Binary.DIVIDE):
        expected = "two numbers"
    return f"`{operator.value}` needs {expected}, found {with_articles((a, b))}"


def _infix_hint(node: ast.Infix, operator: ir.Binary, left: Type, right: Type) -> str | None:
    a, b = element_type(left), element_type(right)
    hint = percent_hint((node.left, left), (node.right, right))
    if hint is not None:
        return hint
    if (isinstance(a, Enum) or isinstance(b, Enum)) and operator not in _EQUALITY | _BOOLEAN:
        return "only `==` and `!=` apply to an enum"
    if (
        isinstance(a, Quantity)
        and isinstance(b, Quantity)
        and DIMENSIONLESS in (a, b)
        and operator not in _BOOLEAN
    ):
        plain, unit = (node.left, b) if a == DIMENSIONLESS else (node.right, a)
        if isinstance(plain, ast.NumberNode):
            return unit_hint(plain.digits, unit)
        units = listed([f"`1 {name}`" for name in common_units(unit.dimension)], "or")
        return f"give it a unit, times {units}; or divide the other: `x / 1 {unit}` is a plain number"
    if isinstance(a, Bool) and isinstance(b, Bool) and operator not in _BOOLEAN:
        return "turn a bool into a number with `if b then 1 else 0`, or count bools with `count`"
    return None
