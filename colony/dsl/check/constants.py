"""Constants: literals, params and arithmetic on them, evaluated while checking."""

from __future__ import annotations

import math
import re
from fractions import Fraction

from colony.ir import expression as ir
from colony.ir.types import ScalarValue
from colony.text.units import Unit, UnitError, parse_unit

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
