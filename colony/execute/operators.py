"""The operators of `Code` and their implementations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum, unique
from math import isfinite
from types import MappingProxyType
from typing import Any

from colony.execute import arithmetic
from colony.ir import angles


@unique
class Operator(Enum):
    """Total, pure functions of scalars. N, B and T stand for number (double), bool and time (integer).

    `N*` stands for one or more. Other functions of the language are composed of these: `a > b` is `b < a`,
    `clamp` is MIN of MAX, `mean` is SUM divided by the count.
    """

    # N -> N; angles are in degrees
    NEGATE = "negate"
    ABS = "abs"
    SIGN = "sign"
    SQRT = "sqrt"
    FLOOR = "floor"
    CEIL = "ceil"
    ROUND = "round"
    SIN = "sin"
    COS = "cos"
    TAN = "tan"
    ASIN = "asin"
    ACOS = "acos"
    # N, N -> N
    ADD = "add"
    SUBTRACT = "subtract"
    MULTIPLY = "multiply"
    DIVIDE = "divide"
    MODULO = "modulo"
    ATAN2 = "atan2"  # (y, x), in degrees
    # N* -> N, from left to right
    MIN = "min"
    MAX = "max"
    SUM = "sum"
    INDEX_OF_MIN = "index_of_min"
    INDEX_OF_MAX = "index_of_max"
    # B* -> N
    COUNT = "count"
    # N, N -> B, by IEEE 754; EQUAL and NOT_EQUAL also take two bools
    LESS = "less"
    LESS_EQUAL = "less_equal"
    EQUAL = "equal"
    NOT_EQUAL = "not_equal"
    # N -> B
    FINITE = "finite"
    # B -> B, B* -> B
    NOT = "not"
    AND = "and"
    OR = "or"
    # (B, X, X) -> X: the second where the first is true, else the third
    SELECT = "select"
    # (table of N or B, N) -> N or B: the element at the index rounded (halves to even) and taken modulo the
    # size; NaN or false for an index that is not finite
    PICK_NUMBER = "pick_number"
    PICK_BOOL = "pick_bool"
    # T, T -> T; T, T -> B; T -> N: nanoseconds / 1e9
    TIME_ADD = "time_add"
    TIME_SUBTRACT = "time_subtract"
    TIME_LESS = "time_less"
    SECONDS = "seconds"


FUNCTIONS: Mapping[Operator, Callable[..., Any]] = MappingProxyType(
    {
        Operator.NEGATE: lambda x: -x,
        Operator.ABS: abs,
        Operator.SIGN: arithmetic.sign_of,
        Operator.SQRT: arithmetic.square_root,
        Operator.FLOOR: arithmetic.round_down,
        Operator.CEIL: arithmetic.round_up,
        Operator.ROUND: arithmetic.round_even,
        Operator.SIN: angles.sine,
        Operator.COS: angles.cosine,
        Operator.TAN: angles.tangent,
        Operator.ASIN: angles.arc_sine,
        Operator.ACOS: angles.arc_cosine,
        Operator.ADD: lambda x, y: x + y,
        Operator.SUBTRACT: lambda x, y: x - y,
        Operator.MULTIPLY: lambda x, y: x * y,
        Operator.DIVIDE: arithmetic.divide,
        Operator.MODULO: arithmetic.modulo,
        Operator.ATAN2: angles.direction,
        Operator.MIN: arithmetic.minimum,
        Operator.MAX: arithmetic.maximum,
        Operator.SUM: arithmetic.total,
        Operator.INDEX_OF_MIN: arithmetic.index_of_min,
        Operator.INDEX_OF_MAX: arithmetic.index_of_max,
        Operator.COUNT: arithmetic.count,
        Operator.LESS: lambda x, y: x < y,
        Operator.LESS_EQUAL: lambda x, y: x <= y,
        Operator.EQUAL: lambda x, y: x == y,
        Operator.NOT_EQUAL: lambda x, y: x != y,
        Operator.FINITE: isfinite,
        Operator.NOT: lambda b: not b,
        Operator.AND: lambda *b: all(b),
        Operator.OR: lambda *b: any(b),
        Operator.SELECT: lambda condition, yes, no: yes if condition else no,
        Operator.PICK_NUMBER: arithmetic.pick_number,
        Operator.PICK_BOOL: arithmetic.pick_bool,
        Operator.TIME_ADD: lambda x, y: x + y,
        Operator.TIME_SUBTRACT: lambda x, y: x - y,
        Operator.TIME_LESS: lambda x, y: x < y,
        Operator.SECONDS: lambda t: t / 1e9,
    }
)
"""Implementation of each operator on Python's floats, bools and ints."""
