"""Ranges of the numbers of a `Code`: their bounds, and whether they can be NaN.

The analysis is sound and fast rather than precise: memory and external input can be anything, and one pass
over the ops suffices. The bounds of `+ - * /` are computed with those operations, which is sound since
rounding is monotone.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, isfinite
from typing import NamedTuple

from colony.execute.arithmetic import divide, round_down, round_even, round_up, square_root
from colony.execute.code import Apply, Code, Kind, Literal, Op, SensorElement, Table
from colony.execute.operators import Operator
from colony.execute.sensors import members, stand_in
from colony.ir.program import Sensor


class Range(NamedTuple):
    """Numbers from `low` to `high`, infinities included, and NaN if `nan`."""

    low: float
    high: float
    nan: bool

    @property
    def finite(self) -> bool:
        """Return True if no value is infinite or NaN."""
        return not self.nan and isfinite(self.low) and isfinite(self.high)

    @property
    def nonzero(self) -> bool:
        """Return True if no value is zero (it may be NaN)."""
        return self.low > 0.0 or self.high < 0.0

    def within(self, low: float | None, high: float | None) -> bool:
        """Return True if all values are within these bounds; NaN is not."""
        return not self.nan and (low is None or low <= self.low) and (high is None or self.high <= high)


ANYTHING = Range(-inf, inf, True)


def ranges(code: Code) -> list[Range]:
    """Return the range of each value of `code`; `ANYTHING` for values that are not numbers."""
    sensors = {s.name: _sensor(s) for s in code.sensors}
    result: list[Range] = []
    for op, kind in zip(code.ops, code.kinds, strict=True):
        if kind is Kind.NUMBER:
            result.append(_range_of(op, result, sensors))
        elif isinstance(op, Table):
            result.append(_union([result[i] for i in op.elements]))
        else:
            result.append(ANYTHING)
    return result


def _range_of(op: Op, result: list[Range], sensors: dict[str, Range]) -> Range:
    match op:
        case Literal(value=value):
            return Range(value, value, False) if value == value else ANYTHING
        case SensorElement(sensor=sensor):
            return sensors[sensor]
        case Apply(operator=operator, arguments=arguments):
            return _applied(operator, [result[i] for i in arguments])
        case _:
            return ANYTHING


def _sensor(sensor: Sensor) -> Range:
    """Return the range of a sensor, including its stand-in for a missing reading."""
    numbers = members(sensor)
    low, high = sensor.low, sensor.high
    if numbers:
        low, high = min(numbers), max(numbers)
    stand_in_value = stand_in(sensor)
    stand_ins = stand_in_value if isinstance(stand_in_value, tuple) else (stand_in_value,)
    return Range(
        min(-inf if low is None else low, *stand_ins), max(inf if high is None else high, *stand_ins), False
    )


def _union(parts: list[Range]) -> Range:
    return Range(min(r.low for r in parts), max(r.high for r in parts), any(r.nan for r in parts))


def _applied(operator: Operator, x: list[Range]) -> Range:
    nan = any(r.nan for r in x)
    match operator:
        case Operator.ADD | Operator.SUM:
            result = x[0]
            for term in x[1:]:
                result = _sum(result, term)
            return result
        case Operator.SUBTRACT:
            return _sum(x[0], Range(-x[1].high, -x[1].low, x[1].nan))
        case Operator.NEGATE:
            return Range(-x[0].high, -x[0].low, nan)
        case Operator.MULTIPLY:
            return _corners(lambda a, b: a * b, x[0], x[1]) if nan is False else ANYTHING
        case Operator.DIVIDE:
            return _corners(divide, x[0], x[1]) if nan is False and x[1].nonzero else ANYTHING
        case Operator.MIN:
            return Range(min(r.low for r in x), min(r.high for r in x), nan)
        case Operator.MAX:
            return Range(max(r.low for r in x), max(r.high for r in x), nan)
        case Operator.SELECT:
            return _union(x[1:])
        case Operator.PICK_NUMBER:
            return Range(x[0].low, x[0].high, x[0].nan or not x[1].finite)
        case Operator.COUNT:
            return Range(0.0, float(len(x)), False)
        case Operator.INDEX_OF_MIN | Operator.INDEX_OF_MAX:
            return Range(0.0, float(len(x) - 1), False)
        case Operator.SECONDS:
            return Range(0.0, 1e300, False)
        case _:
            return _applied_to_one(operator, x)


def _applied_to_one(operator: Operator, x: list[Range]) -> Range:
    operand, nan = x[0], any(r.nan for r in x)
    infinite = not (isfinite(operand.low) and isfinite(operand.high))
    match operator:
        case Operator.ABS:
            low = 0.0 if operand.low <= 0.0 <= operand.high else min(abs(operand.low), abs(operand.high))
            return Range(low, max(abs(operand.low), abs(operand.high)), nan)
        case Operator.SIGN:
            return Range(-1.0, 1.0, nan)
        case Operator.SQRT:
            return Range(
                square_root(max(operand.low, 0.0)),
                square_root(max(operand.high, 0.0)),
                nan or operand.low < 0.0,
            )
        case Operator.FLOOR:
            return Range(round_down(operand.low), round_down(operand.high), nan)
        case Operator.CEIL:
            return Range(round_up(operand.low), round_up(operand.high), nan)
        case Operator.ROUND:
            return Range(round_even(operand.low), round_even(operand.high), nan)
        case Operator.SIN | Operator.COS:
            return Range(-1.0, 1.0, nan or infinite)
        case Operator.ASIN:
            return Range(-90.0, 90.0, nan or operand.low < -1.0 or operand.high > 1.0)
        case Operator.ACOS:
            return Range(0.0, 180.0, nan or operand.low < -1.0 or operand.high > 1.0)
        case Operator.ATAN2:
            return Range(-180.0, 180.0, nan)
        case Operator.MODULO if x[1].low > 0.0 and isfinite(x[1].high):
            return Range(0.0, x[1].high, nan or infinite)
        case _:
            return ANYTHING


def _sum(x: Range, y: Range) -> Range:
    sum_is_nan = (x.high == inf and y.low == -inf) or (x.low == -inf and y.high == inf)
    low, high = x.low + y.low, x.high + y.high
    if low != low or high != high:
        return ANYTHING
    return Range(low, high, x.nan or y.nan or sum_is_nan)


def _corners(function: Callable[[float, float], float], x: Range, y: Range) -> Range:
    """Return the range of a function that is monotone in each operand; `ANYTHING` for infinite operands."""
    if not (x.finite and y.finite):
        return ANYTHING
    corners = [function(a, b) for a in (x.low, x.high) for b in (y.low, y.high)]
    return Range(min(corners), max(corners), False)
