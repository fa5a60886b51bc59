"""Expressions: names to what they stand for, units to factors, each node with its type.

A check gives the typed expression, or None after it has reported why there is none; whoever gets None goes
on with the rest, so that all that is wrong is said at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from math import isfinite

from colony.dsl import ast
from colony.dsl.check import calls
from colony.dsl.check.compatibility import article, articles, fits, unify
from colony.dsl.check.constants import constant_value, literal, unit_of
from colony.dsl.check.references import resolve_reference, resolve_status, resolve_winner
from colony.dsl.check.scope import Report, Scope, ValueSymbol, span_of
from colony.ir import expression as ir
from colony.ir.types import (
    BOOL,
    PLAIN,
    ZERO,
    Array,
    Bool,
    Enum,
    Quantity,
    Scalar,
    ScalarValue,
    Type,
    element_type,
)
from colony.text.source import Span
from colony.text.units import TIME, BadUnit, nanoseconds

MAX_DURATION_NS = 10**18
"""So that sums of times fit 64 bits in every executor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Checker:
    """What an expression may name, and where findings go.

    `local` hides the file's names; `promise` allows what only contracts and expectations may say;
    `memory` allows memory functions; `constants` says that only constants can stand here; `later` are the
    names that the module declares, perhaps further down; `loops` are the variables of enclosing reductions.
    """

    scope: Scope
    report: Report
    local: Mapping[str, ValueSymbol] = field(default_factory=dict)
    promise: bool = False
    memory: bool = True
    constants: bool = False
    later: frozenset[str] = frozenset()
    loops: Mapping[str, str] = field(default_factory=dict)
    iterations: int = 1

    # --- entries

    def check(self, node: ast.Expression) -> ir.Expression | None:
        """The typed expression, whatever its type."""
        if node.depth > ir.NESTING_LIMIT:
            message = f"the expression nests {node.depth} deep; at most {ir.NESTING_LIMIT} are allowed"
            self.error("E004", node, message, "name parts of it with `let`")
            return None
        return self.visit(node)

    def expect(self, node: ast.Expression, wanted: Type, what: str) -> ir.Expression | None:
        """The typed expression if its type is `wanted`; `what` names its place in the message."""
        found = self.check(node)
        if found is None:
            return None
        if fits(found.type, wanted):
            return found
        hint = _type_hint(node, found.type, wanted)
        self.error("E202", node, f"{what} must be {article(wanted)}, found {article(found.type)}", hint)
        return None

    def constant(self, node: ast.Expression, wanted: Scalar | None, what: str) -> ir.Constant | None:
        """A constant, finite, of type `wanted` (of any scalar type for None)."""
        constants = replace(self, memory=False, constants=True)
        found = constants.check(node) if wanted is None else constants.expect(node, wanted, what)
        if found is None:
            return None
        value = constant_value(found)
        if value is None or isinstance(found.type, Array):
            self.error(
                "E204", node, f"{what} must be constant", "use literals, params and arithmetic on them"
            )
            return None
        if not abs(value) < float("inf"):
            self.error("E212", node, f"{what} is not a finite number")
            return None
        type_ = found.type if wanted is None or not isinstance(found.type, Quantity) else wanted
        return ir.Constant(type=type_, value=value, span=found.span)

    def constant_in(self, node: ast.Expression, type_: Scalar, unit: str, what: str) -> ScalarValue | None:
        """A constant of `type_` where a plain number is taken to be in the declared unit."""
        sign, bare = 1.0, node
        while isinstance(bare, ast.Prefix) and bare.operator == "-":
            sign, bare = -sign, bare.operand
        if isinstance(type_, Quantity) and isinstance(bare, ast.Number) and bare.unit is None:
            value = self._literal(bare, unit)
            return None if value is None else sign * value
        if isinstance(type_, Quantity) and not type_.wild:
            found = self.constant(node, None, what)
            if found is None:
                return None
            if isinstance(found.type, Quantity) and found.type.dimension == PLAIN.dimension:
                return float(found.value) * float(unit_of(unit).factor) if unit else found.value  # type: ignore[arg-type,return-value]
            if fits(found.type, type_):
                return found.value  # type: ignore[return-value]
            self.error("E202", node, f"{what} must be {article(type_)}, found {article(found.type)}")
            return None
        found = self.constant(node, type_, what)
        return None if found is None else found.value  # type: ignore[return-value]

    def duration_ns(self, node: ast.Expression, what: str) -> int | None:
        """A constant time as whole nanoseconds, not negative."""
        found = self.constant(node, Quantity(TIME), what)
        if found is None:
            return None
        ns = nanoseconds(found.value)  # type: ignore[arg-type]
        if ns < 0:
            self.error("E213", node, f"{what} is negative", "durations count forward")
            return None
        if ns > MAX_DURATION_NS:
            years = MAX_DURATION_NS // (365 * 86_400 * 10**9)
            self.error("E213", node, f"{what} is longer than {years} years")
            return None
        return ns

    def whole(self, node: ast.Expression, what: str, low: int, high: int) -> int | None:
        """A constant whole number from `low` to `high`."""
        found = self.constant(node, PLAIN, what)
        if found is None:
            return None
        value = found.value
        if not isinstance(value, float) or value != int(value) or not low <= value <= high:
            shown = f"{value:g}" if isinstance(value, float) else str(value).lower()
            self.error("E214", node, f"{what} must be a whole number from {low} to {high}, found {shown}")
            return None
        return int(value)

    # --- shared

    def error(self, code: str, node: ast.Node, message: str, hint: str | None = None) -> None:
        self.report.error(self.scope, code, node, message, hint)

    def span(self, node: ast.Node) -> Span:
        return span_of(self.scope, node)

    # --- nodes

    def visit(self, node: ast.Expression) -> ir.Expression | None:
        """By kind of node; depth was checked by `check`."""
        match node:
            case ast.Number():
                return self._number(node)
            case ast.Boolean():
                return ir.Constant(type=BOOL, value=node.value, span=self.span(node))
            case ast.Reference():
                return resolve_reference(self, node)
            case ast.Prefix():
                return self._prefix(node)
            case ast.Infix():
                return self._infix(node)
            case ast.If():
                return self._if(node)
            case ast.InRange():
                return self._in_range(node)
            case ast.Index():
                return self._index(node)
            case ast.SliceOf():
                return self._slice(node)
            case ast.Call():
                return calls.check_call(self, node)
            case ast.Comprehension():
                return calls.check_comprehension(self, node)
            case ast.By():
                return resolve_winner(self, node)
            case ast.Is():
                return resolve_status(self, node)

    def _literal(self, node: ast.Number, unit: str | None) -> float | None:
        try:
            factor = unit_of(unit).factor if unit else Fraction(1)
        except BadUnit as problem:
            self.error("E011", node, str(problem))
            return None
        value = literal(node.digits, factor)
        if value is None:
            self.error("E010", node, "the number is too large for a 64-bit float")
        return value

    def _number(self, node: ast.Number) -> ir.Expression | None:
        value = self._literal(node, node.unit)
        if value is None:
            return None
        type_ = Quantity(unit_of(node.unit).dimension) if node.unit else (PLAIN if value != 0 else ZERO)
        return ir.Constant(type=type_, value=value, span=self.span(node))

    def _prefix(self, node: ast.Prefix) -> ir.Expression | None:
        operand = self.visit(node.operand)
        if operand is None:
            return None
        element, span = element_type(operand.type), self.span(node)
        if node.operator == "not":
            if not isinstance(element, Bool):
                self.error("E201", node.operand, f"`not` needs a bool, found {article(operand.type)}")
                return None
            return ir.UnaryOperation(type=operand.type, operator=ir.Unary.NOT, operand=operand, span=span)
        if not isinstance(element, Quantity):
            self.error("E201", node.operand, f"`-` needs a number, found {article(operand.type)}")
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

    def broadcast(self, node: ast.Node, element: Scalar, *types: Type) -> Type | None:
        """`element`, or an array of it: scalars fit any array, arrays must agree in length."""
        sizes = sorted({t.size for t in types if isinstance(t, Array)})
        if len(sizes) > 1:
            shown = " and ".join(str(s) for s in sizes)
            self.error("E206", node, f"the arrays differ in length: {shown} elements")
            return None
        return Array(element, sizes[0]) if sizes else element

    def _if(self, node: ast.If) -> ir.Expression | None:
        condition = self.visit(node.condition)
        yes, no = self.visit(node.yes), self.visit(node.no)
        if condition is not None and not isinstance(condition.type, Bool):
            found = article(condition.type)
            self.error("E202", node.condition, f"the condition of `if` must be a bool, found {found}")
            condition = None
        if condition is None or yes is None or no is None:
            return None
        element = unify(element_type(yes.type), element_type(no.type))
        if element is None:
            message = f"the branches of `if` differ: {article(yes.type)} and {article(no.type)}"
            self.error("E201", node, message)
            return None
        type_ = self.broadcast(node, element, yes.type, no.type)
        if type_ is None:
            return None
        return ir.Conditional(type=type_, condition=condition, yes=yes, no=no, span=self.span(node))

    def _in_range(self, node: ast.InRange) -> ir.Expression | None:
        parts = [self.visit(p) for p in (node.operand, node.low, node.high)]
        operand, low, high = parts
        if operand is None or low is None or high is None:
            return None
        elements = [element_type(p.type) for p in (operand, low, high)]
        first = unify(elements[0], elements[1])
        if first is None or unify(first, elements[2]) is None or not isinstance(first, Quantity):
            shown = articles(p.type for p in (operand, low, high))
            self.error("E201", node, f"`in` needs three numbers of one dimension, found {shown}")
            return None
        type_ = self.broadcast(node, BOOL, operand.type, low.type, high.type)
        if type_ is None:
            return None
        return ir.Within(type=type_, operand=operand, low=low, high=high, span=self.span(node))

    def array(self, node: ast.Expression) -> ir.Expression | None:
        """An expression that must be an array."""
        found = self.visit(node)
        if found is not None and not isinstance(found.type, Array):
            self.error("E207", node, f"expected an array, found {article(found.type)}")
            return None
        return found

    def _index(self, node: ast.Index) -> ir.Expression | None:
        array, index = self.array(node.array), self.visit(node.index)
        if array is None or index is None:
            return None
        assert isinstance(array.type, Array)
        if not isinstance(index.type, Quantity) or index.type.dimension != PLAIN.dimension:
            self.error("E202", node.index, f"an index must be a plain number, found {article(index.type)}")
            return None
        value = constant_value(index)
        if value is not None and not (isfinite(value) and 0 <= round(value) < array.type.size):
            last = array.type.size - 1
            self.error(
                "E205", node.index, f"index {value:g} is outside the array", f"it has indices 0 .. {last}"
            )
            return None
        return ir.Element(type=array.type.element, array=array, index=index, span=self.span(node))

    def _slice(self, node: ast.SliceOf) -> ir.Expression | None:
        array = self.array(node.array)
        if array is None:
            return None
        assert isinstance(array.type, Array)
        last_index = array.type.size - 1
        first = self.whole(node.first, "the start of a slice", 0, last_index)
        last = self.whole(node.last, "the end of a slice", 0, last_index)
        if first is None or last is None:
            return None
        stop = last if first <= last else last + array.type.size
        indices = tuple(i % array.type.size for i in range(first, stop + 1))
        type_ = Array(array.type.element, len(indices))
        return ir.Slice(type=type_, array=array, indices=indices, span=self.span(node))


# --- operators -------------------------------------------------------------------------------------

_BOOLEAN = frozenset({ir.Binary.AND, ir.Binary.OR, ir.Binary.IMPLIES})
_EQUALITY = frozenset({ir.Binary.EQUAL, ir.Binary.NOT_EQUAL})
_SUMS = frozenset({ir.Binary.ADD, ir.Binary.SUBTRACT})


def _result(operator: ir.Binary, a: Scalar, b: Scalar) -> Scalar | None:
    """The element type of an operation, or None where the operands do not fit it."""
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
    both = unify(a, b)
    return both if both is None or operator in _SUMS else BOOL


def _mismatch(operator: ir.Binary, a: Type, b: Type) -> str:
    wanted = "two bools" if operator in _BOOLEAN else "two values of one type"
    if operator in _SUMS or (operator not in _BOOLEAN and operator not in _EQUALITY):
        wanted = "two numbers of one dimension"
    if operator in (ir.Binary.MULTIPLY, ir.Binary.DIVIDE):
        wanted = "two numbers"
    return f"`{operator.value}` needs {wanted}, found {articles((a, b))}"


def _infix_hint(node: ast.Infix, operator: ir.Binary, left: Type, right: Type) -> str | None:
    a, b = element_type(left), element_type(right)
    if (isinstance(a, Enum) or isinstance(b, Enum)) and operator not in _EQUALITY | _BOOLEAN:
        return "only `==` and `!=` apply to an enum"
    if isinstance(a, Quantity) and isinstance(b, Quantity) and PLAIN in (a, b) and operator not in _BOOLEAN:
        plain, unit = (node.left, b) if a == PLAIN else (node.right, a)
        if isinstance(plain, ast.Number):
            return f"write its unit, for example `{plain.digits[:20]} {unit}`"
        return f"give it a unit, times `1 {unit}`; or divide the other: `x / 1 {unit}` is a plain number"
    if isinstance(a, Bool) and isinstance(b, Bool) and operator not in _BOOLEAN:
        return "turn a bool into a number with `if b then 1 else 0`, or count bools with `count`"
    return None


def _type_hint(node: ast.Expression, found: Type, wanted: Type) -> str | None:
    if isinstance(found, Array) and not isinstance(wanted, Array):
        if isinstance(wanted, Bool):
            return "reduce the array with `any(...)` or `all(...)`"
        return "take an element, or reduce the array with `min`, `max`, `mean` or `sum`"
    if not isinstance(found, Quantity) or not isinstance(wanted, Quantity):
        return None
    if isinstance(node, ast.Number) and node.unit is None:
        return f"write its unit, for example `{node.digits[:20]} {wanted}`"
    if found == PLAIN:
        return f"give it a unit: times `1 {wanted}`"
    return f"divide by a unit for a plain number: `x / 1 {found}`" if wanted == PLAIN else None
