"""The signatures of operators: the kinds of their arguments and results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from colony.execute.code import Kind
from colony.execute.operators import Operator

_N, _B, _T, _TABLE = Kind.NUMBER, Kind.BOOL, Kind.TIME, Kind.TABLE

_FIXED: Mapping[Operator, tuple[tuple[Kind, ...], Kind]] = MappingProxyType(
    {
        **dict.fromkeys(
            (
                Operator.NEGATE,
                Operator.ABS,
                Operator.SIGN,
                Operator.SQRT,
                Operator.FLOOR,
                Operator.CEIL,
                Operator.ROUND,
                Operator.SIN,
                Operator.COS,
                Operator.TAN,
                Operator.ASIN,
                Operator.ACOS,
            ),
            ((_N,), _N),
        ),
        **dict.fromkeys(
            (
                Operator.ADD,
                Operator.SUBTRACT,
                Operator.MULTIPLY,
                Operator.DIVIDE,
                Operator.MODULO,
                Operator.ATAN2,
            ),
            ((_N, _N), _N),
        ),
        Operator.LESS: ((_N, _N), _B),
        Operator.LESS_EQUAL: ((_N, _N), _B),
        Operator.EQUAL: ((_N, _N), _B),
        Operator.NOT_EQUAL: ((_N, _N), _B),
        Operator.FINITE: ((_N,), _B),
        Operator.NOT: ((_B,), _B),
        Operator.PICK_NUMBER: ((_TABLE, _N), _N),
        Operator.PICK_BOOL: ((_TABLE, _N), _B),
        Operator.TIME_ADD: ((_T, _T), _T),
        Operator.TIME_SUBTRACT: ((_T, _T), _T),
        Operator.TIME_LESS: ((_T, _T), _B),
        Operator.SECONDS: ((_T,), _N),
    }
)

_VARIADIC: Mapping[Operator, tuple[Kind, Kind]] = MappingProxyType(
    {
        Operator.MIN: (_N, _N),
        Operator.MAX: (_N, _N),
        Operator.SUM: (_N, _N),
        Operator.INDEX_OF_MIN: (_N, _N),
        Operator.INDEX_OF_MAX: (_N, _N),
        Operator.COUNT: (_B, _N),
        Operator.AND: (_B, _B),
        Operator.OR: (_B, _B),
    }
)


RESULTS: Mapping[Operator, Kind] = MappingProxyType(
    {operator: result for operator, (_, result) in (*_FIXED.items(), *_VARIADIC.items())}
)
"""Kind of the result of each operator except SELECT."""


def result_of(operator: Operator, arguments: Sequence[Kind]) -> Kind | None:
    """Return the kind of an operator's result for arguments of these kinds, None if they do not fit."""
    if operator is Operator.SELECT:
        fits = len(arguments) == 3 and arguments[0] is _B and arguments[1] is arguments[2] is not _TABLE
        return arguments[1] if fits else None
    if operator in (Operator.EQUAL, Operator.NOT_EQUAL) and tuple(arguments) == (_B, _B):
        return _B
    if operator in _VARIADIC:
        argument, result = _VARIADIC[operator]
        return result if arguments and all(kind is argument for kind in arguments) else None
    expected, result = _FIXED[operator]
    return result if tuple(arguments) == expected else None
