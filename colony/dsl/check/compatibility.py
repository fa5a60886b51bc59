"""Type compatibility, and the wording of types in messages."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from fractions import Fraction

from colony.dsl.check.scope import ArgumentSymbol
from colony.ir import expression as ir
from colony.ir.types import (
    BOOL,
    DIMENSIONLESS,
    Array,
    Bool,
    Enum,
    Quantity,
    Scalar,
    ScalarValue,
    Type,
    element_type,
    in_shape_of,
    is_percent,
    type_text,
)
from colony.text.source import Span
from colony.text.units import Unit, UnitError, parse_unit
from colony.text.wording import listed

# --- constants ----------------------------------------------------------------------------------------
#
# Constants: literals, params and arithmetic on them, evaluated while checking.

_NUMBER = re.compile(r"(\d+)(?:\.(\d+))?(?:[eE]([+-]?\d+))?")
_MAX_DIGITS = 1100
_MAX_MAGNITUDE = 400
_MAX_UNIT_LENGTH = 100


def literal(digits: str, factor: Fraction) -> float | None:
    """Return the double nearest to `digits` times `factor`, rounded once; None if it overflows.

    Of the digits beyond `_MAX_DIGITS` it only matters whether any is nonzero.
    """
    match = _NUMBER.fullmatch(digits)
    assert match is not None, "the grammar accepts no other numbers"
    whole, fraction, exponent_text = match[1], match[2] or "", match[3] or "0"
    significant = (whole + fraction).lstrip("0")
    exponent = _bound_exponent(exponent_text) - len(fraction)
    if len(significant) > _MAX_DIGITS:
        exponent += len(significant) - _MAX_DIGITS - 1
        sticky = "1" if significant[_MAX_DIGITS:].strip("0") else "0"
        significant = significant[:_MAX_DIGITS] + sticky
    if not significant:
        return 0.0
    magnitude = len(significant) + exponent
    if magnitude > _MAX_MAGNITUDE:
        return None
    if magnitude < -_MAX_MAGNITUDE:
        return 0.0
    exact = int(significant) * Fraction(10) ** exponent * factor
    try:
        return float(exact)
    except OverflowError:
        return None


def _bound_exponent(exponent: str) -> int:
    """Return the exponent, or a bound with the same effect if it is huge."""
    digits = exponent.lstrip("+-").lstrip("0")
    size = int(digits or "0") if len(digits) < 12 else 10**12
    return -size if exponent.startswith("-") else size


def unit_of(text: str) -> Unit:
    """Return the unit that this text denotes.

    Raises:
        UnitError: as for `parse_unit`, or the text is too long.
    """
    if len(text) > _MAX_UNIT_LENGTH:
        raise UnitError(f"a unit of {len(text)} characters; at most {_MAX_UNIT_LENGTH} are allowed")
    return parse_unit(text)


def constant_value(node: ir.Expression) -> ScalarValue | None:
    """Return the value of a scalar constant expression, None if it is not constant.

    A division by zero or an overflow gives NaN or infinity.
    """
    match node:
        case ir.Constant(value=bool() | float() as value):
            return value
        case ir.UnaryOperation(operator=ir.Unary.NEGATE, operand=operand):
            negated = constant_value(operand)
            return None if negated is None else -negated
        case ir.BinaryOperation(operator=operator, left=left, right=right) if operator in _ARITHMETIC:
            a, b = constant_value(left), constant_value(right)
            return None if a is None or b is None else _arithmetic(operator, a, b)
        case _:
            return None


_ARITHMETIC = frozenset({ir.Binary.ADD, ir.Binary.SUBTRACT, ir.Binary.MULTIPLY, ir.Binary.DIVIDE})


def _arithmetic(operator: ir.Binary, a: float, b: float) -> float:
    match operator:
        case ir.Binary.ADD:
            return a + b
        case ir.Binary.SUBTRACT:
            return a - b
        case ir.Binary.MULTIPLY:
            return a * b
        case _:
            return a / b if b != 0 else math.nan


# --- compatibility ------------------------------------------------------------------------------------


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


# --- arguments ----------------------------------------------------------------------------------------
#
# Arguments of functions: expressions of the caller that stand in the place of parameters.

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
    return ir.FunctionCall(type=BOOL, function=ir.Function.ALL, arguments=tuple(parts), span=span)


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
