"""Constants: literals, params and arithmetic on them, evaluated while checking."""

from __future__ import annotations

import math
import re
from fractions import Fraction

from colony.ir import expression as ir
from colony.ir.types import ScalarValue

_NUMBER = re.compile(r"(\d+)(?:\.(\d+))?(?:[eE]([+-]?\d+))?")
_LONGEST = 1100
_LARGEST_EXPONENT = 400


def literal(digits: str, factor: Fraction) -> float | None:
    """The double nearest to `digits` times `factor`, rounded once; None where it overflows or is too long."""
    match = _NUMBER.fullmatch(digits)
    if match is None or len(digits) > _LONGEST:
        return None
    whole, fraction, exponent_text = match[1], match[2] or "", match[3] or "0"
    mantissa = int(whole + fraction)
    if mantissa == 0:
        return 0.0
    negative, size = exponent_text.startswith("-"), exponent_text.lstrip("+-").lstrip("0") or "0"
    exponent = int(size[:9]) * (-1 if negative else 1) - len(fraction)
    magnitude = len(str(mantissa)) + exponent
    if magnitude > _LARGEST_EXPONENT:
        return None
    if magnitude < -_LARGEST_EXPONENT:
        return 0.0
    exact = Fraction(mantissa) * Fraction(10) ** exponent * factor
    try:
        return float(exact)
    except OverflowError:
        return None


def constant_value(node: ir.Expression) -> ScalarValue | None:
    """The value of a scalar constant expression; None where it is not constant.

    A result that is not finite (division by zero, overflow) comes back as NaN or infinity.
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
