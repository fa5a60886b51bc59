"""Ops as Python expressions, with no more parentheses than are needed.

Where NaN and division by zero are impossible, Python's own operators and functions are used, elsewhere those
of `colony.execute.arithmetic`.
"""

from __future__ import annotations

import builtins
import keyword
import math
import re
from collections.abc import Callable
from enum import IntEnum
from math import inf, isfinite
from typing import NamedTuple

from colony.execute.arithmetic import divide, round_down, round_even, round_up, square_root
from colony.execute.code import Apply, Code, Kind, Literal, Op, SensorElement, Table
from colony.execute.operators import Operator
from colony.execute.sensors import members, stand_in
from colony.ir.program import Sensor

# --- names --------------------------------------------------------------------------------------------
#
# Names in a generated program: unique, and close to those in the source.

_RESERVED = frozenset({*dir(builtins), *keyword.kwlist, *keyword.softkwlist, *dir(math)})
_RESERVED_VARIABLES = frozenset(
    {
        "self",
        "first_ns",
        "step",
        "t",
        "t_ns",
        "readings",
        "taken_ns",
        "restarted",
        "records",
        "breaches",
        "reading",
        "settled",
        "fault",
    }
)


class UniqueNames:
    """Names of variables and attributes. Stateful: remembers all names, so that each is unique."""

    def __init__(self, code: Code, taken: frozenset[str]) -> None:
        """Reserve the names of the functions that the program includes (`taken`)."""
        self._taken = {*_RESERVED, *_RESERVED_VARIABLES, *taken}
        self._hints = code.names
        self.sensors = {s.name: self.new(s.name) for s in code.sensors}
        self.last = {s.name: self.new(f"kept_{s.name}") for s in code.sensors if s.sent is not None}
        self.fresh = {s.name: self.new(f"has_{s.name}") for s in code.sensors}
        self.python = {c.module: self.new(f"python_{c.module}") for c in code.python}
        self.python_active = {c.module: self.new(f"{c.module}_active") for c in code.python}
        self.python_blind = {c.module: self.new(f"{c.module}_blind") for c in code.python}
        self.python_fields = {c.module: self.new(f"{c.module}_fields") for c in code.python}
        self.decision = {a.actuator.name: self.new(a.actuator.name) for a in code.actuators}
        self.by = {a.actuator.name: self.new(f"{a.actuator.name}_by") for a in code.actuators}
        self.blind = {a.actuator.name: self.new(f"{a.actuator.name}_blind") for a in code.actuators}
        self.commanded = {a.actuator.name: self.new(f"{a.actuator.name}_commanded") for a in code.actuators}
        self.field = {
            (a.actuator.name, i): self.new(f"{a.actuator.name}_{f.name}")
            for a in code.actuators
            for i, f in enumerate(a.actuator.fields)
        }
        self.bounds = {a.actuator.name: self.new(f"{a.actuator.name}_bounds") for a in code.actuators}
        self.cells = [self.new(c.name) for c in code.cells]

    def value(self, number: int) -> str:
        """Return a new name for a value of the `Code`."""
        return self.new(self._hints.get(number, f"v{number}"))

    def new(self, wanted: str) -> str:
        """Return `wanted` as an identifier, with a number appended if it is taken."""
        base = re.sub(r"\W", "_", wanted)
        if not base.isascii() or not base.isidentifier() or base.startswith("_"):
            base = "v" + re.sub(r"[^A-Za-z0-9_]", "_", base)
        name, n = base, 2
        while name in self._taken:
            name, n = f"{base}_{n}", n + 1
        self._taken.add(name)
        return name


# --- ranges -------------------------------------------------------------------------------------------
#
# Ranges of the numbers of a `Code`: their bounds, and whether they can be NaN.
#
# The analysis is sound and fast rather than precise: memory and external input can be anything, and one pass
# over the ops suffices. The bounds of `+ - * /` are computed with those operations, which is sound since
# rounding is monotone.


class NumberRange(NamedTuple):
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


ANYTHING = NumberRange(-inf, inf, True)


def ranges(code: Code) -> list[NumberRange]:
    """Return the range of each value of `code`; `ANYTHING` for values that are not numbers."""
    sensors = {s.name: _sensor(s) for s in code.sensors}
    result: list[NumberRange] = []
    for op, kind in zip(code.ops, code.kinds, strict=True):
        if kind is Kind.NUMBER:
            result.append(_range_of(op, result, sensors))
        elif isinstance(op, Table):
            result.append(_union([result[i] for i in op.elements]))
        else:
            result.append(ANYTHING)
    return result


def _range_of(op: Op, result: list[NumberRange], sensors: dict[str, NumberRange]) -> NumberRange:
    match op:
        case Literal(value=value):
            return NumberRange(value, value, False) if value == value else ANYTHING
        case SensorElement(sensor=sensor):
            return sensors[sensor]
        case Apply(operator=operator, arguments=arguments):
            return _range_applied(operator, [result[i] for i in arguments])
        case _:
            return ANYTHING


def _sensor(sensor: Sensor) -> NumberRange:
    """Return the range of a sensor, including its stand-in for a missing reading."""
    numbers = members(sensor)
    low, high = sensor.low, sensor.high
    if numbers:
        low, high = min(numbers), max(numbers)
    stand_in_value = stand_in(sensor)
    stand_ins = stand_in_value if isinstance(stand_in_value, tuple) else (stand_in_value,)
    return NumberRange(
        min(-inf if low is None else low, *stand_ins), max(inf if high is None else high, *stand_ins), False
    )


def _union(parts: list[NumberRange]) -> NumberRange:
    return NumberRange(min(r.low for r in parts), max(r.high for r in parts), any(r.nan for r in parts))


def _range_applied(operator: Operator, x: list[NumberRange]) -> NumberRange:
    nan = any(r.nan for r in x)
    match operator:
        case Operator.ADD | Operator.SUM:
            result = x[0]
            for term in x[1:]:
                result = _sum_range(result, term)
            return result
        case Operator.SUBTRACT:
            return _sum_range(x[0], NumberRange(-x[1].high, -x[1].low, x[1].nan))
        case Operator.NEGATE:
            return NumberRange(-x[0].high, -x[0].low, nan)
        case Operator.MULTIPLY:
            return _corners(lambda a, b: a * b, x[0], x[1]) if nan is False else ANYTHING
        case Operator.DIVIDE:
            return _corners(divide, x[0], x[1]) if nan is False and x[1].nonzero else ANYTHING
        case Operator.MIN:
            return NumberRange(min(r.low for r in x), min(r.high for r in x), nan)
        case Operator.MAX:
            return NumberRange(max(r.low for r in x), max(r.high for r in x), nan)
        case Operator.SELECT:
            return _union(x[1:])
        case Operator.PICK_NUMBER:
            return NumberRange(x[0].low, x[0].high, x[0].nan or not x[1].finite)
        case Operator.COUNT:
            return NumberRange(0.0, float(len(x)), False)
        case Operator.INDEX_OF_MIN | Operator.INDEX_OF_MAX:
            return NumberRange(0.0, float(len(x) - 1), False)
        case Operator.SECONDS:
            return NumberRange(0.0, 1e300, False)
        case _:
            return _applied_to_one(operator, x)


def _applied_to_one(operator: Operator, x: list[NumberRange]) -> NumberRange:
    operand, nan = x[0], any(r.nan for r in x)
    infinite = not (isfinite(operand.low) and isfinite(operand.high))
    match operator:
        case Operator.ABS:
            low = 0.0 if operand.low <= 0.0 <= operand.high else min(abs(operand.low), abs(operand.high))
            return NumberRange(low, max(abs(operand.low), abs(operand.high)), nan)
        case Operator.SIGN:
            return NumberRange(-1.0, 1.0, nan)
        case Operator.SQRT:
            return NumberRange(
                square_root(max(operand.low, 0.0)),
                square_root(max(operand.high, 0.0)),
                nan or operand.low < 0.0,
            )
        case Operator.FLOOR:
            return NumberRange(round_down(operand.low), round_down(operand.high), nan)
        case Operator.CEIL:
            return NumberRange(round_up(operand.low), round_up(operand.high), nan)
        case Operator.ROUND:
            return NumberRange(round_even(operand.low), round_even(operand.high), nan)
        case Operator.SIN | Operator.COS:
            return NumberRange(-1.0, 1.0, nan or infinite)
        case Operator.ASIN:
            return NumberRange(-90.0, 90.0, nan or operand.low < -1.0 or operand.high > 1.0)
        case Operator.ACOS:
            return NumberRange(0.0, 180.0, nan or operand.low < -1.0 or operand.high > 1.0)
        case Operator.ATAN2:
            return NumberRange(-180.0, 180.0, nan)
        case Operator.MODULO if x[1].low > 0.0 and isfinite(x[1].high):
            return NumberRange(0.0, x[1].high, nan or infinite)
        case _:
            return ANYTHING


def _sum_range(x: NumberRange, y: NumberRange) -> NumberRange:
    sum_is_nan = (x.high == inf and y.low == -inf) or (x.low == -inf and y.high == inf)
    low, high = x.low + y.low, x.high + y.high
    if low != low or high != high:
        return ANYTHING
    return NumberRange(low, high, x.nan or y.nan or sum_is_nan)


def _corners(function: Callable[[float, float], float], x: NumberRange, y: NumberRange) -> NumberRange:
    """Return the range of a function that is monotone in each operand; `ANYTHING` for infinite operands."""
    if not (x.finite and y.finite):
        return ANYTHING
    corners = [function(a, b) for a in (x.low, x.high) for b in (y.low, y.high)]
    return NumberRange(min(corners), max(corners), False)


# --- text ---------------------------------------------------------------------------------------------


class Precedence(IntEnum):
    """The precedence of the outermost operator of an expression."""

    CONDITIONAL = 0
    OR = 1
    AND = 2
    NOT = 3
    COMPARISON = 4
    SUM = 6
    PRODUCT = 7
    SIGN = 8
    ATOM = 10


class ExpressionText(NamedTuple):
    """The text of an expression; `depth` is its nesting depth, which Python's parser limits."""

    text: str
    binding: Precedence = Precedence.ATOM
    depth: int = 0

    def inside(self, binding: int) -> str:
        """Return the text as an operand that must bind at least as tightly as `binding`."""
        return self.text if self.binding >= binding else f"({self.text})"


TRUE = ExpressionText("True")

INFIX: dict[Operator, tuple[str, Precedence]] = {
    Operator.ADD: ("+", Precedence.SUM),
    Operator.SUBTRACT: ("-", Precedence.SUM),
    Operator.TIME_ADD: ("+", Precedence.SUM),
    Operator.TIME_SUBTRACT: ("-", Precedence.SUM),
    Operator.MULTIPLY: ("*", Precedence.PRODUCT),
    Operator.DIVIDE: ("/", Precedence.PRODUCT),
    Operator.LESS: ("<", Precedence.COMPARISON),
    Operator.TIME_LESS: ("<", Precedence.COMPARISON),
    Operator.LESS_EQUAL: ("<=", Precedence.COMPARISON),
    Operator.EQUAL: ("==", Precedence.COMPARISON),
    Operator.NOT_EQUAL: ("!=", Precedence.COMPARISON),
}
"""The operators that C writes in the same way."""

_INFIX = INFIX | {Operator.MODULO: ("%", Precedence.PRODUCT)}

_CALLS: dict[Operator, str] = {
    Operator.ABS: "abs",
    Operator.SIGN: "sign_of",
    Operator.SQRT: "square_root",
    Operator.FLOOR: "round_down",
    Operator.CEIL: "round_up",
    Operator.ROUND: "round_even",
    Operator.SIN: "sine",
    Operator.COS: "cosine",
    Operator.TAN: "tangent",
    Operator.ASIN: "arc_sine",
    Operator.ACOS: "arc_cosine",
    Operator.DIVIDE: "divide",
    Operator.MODULO: "modulo",
    Operator.ATAN2: "direction",
    Operator.MIN: "minimum",
    Operator.MAX: "maximum",
    Operator.INDEX_OF_MIN: "index_of_min",
    Operator.INDEX_OF_MAX: "index_of_max",
    Operator.FINITE: "isfinite",
    Operator.PICK_NUMBER: "pick_number",
    Operator.PICK_BOOL: "pick_bool",
}


def literal(value: float | bool | int) -> ExpressionText:
    """Return a constant; NaN and infinity are written by their names in `math`."""
    if isinstance(value, bool):
        return ExpressionText(repr(value))
    if isinstance(value, int):
        text = f"{value:_}"
    else:
        text = repr(value)
    return ExpressionText(text, Precedence.SIGN if text.startswith("-") else Precedence.ATOM)


def mentions_twice(operator: Operator, x: list[NumberRange]) -> bool:
    """Return True if the operator's text repeats its operands, so that these should be variables."""
    match operator:
        case Operator.MIN | Operator.MAX:
            return len(x) == 2 and not any(r.nan for r in x)
        case Operator.DIVIDE:
            return not x[1].nonzero
        case _:
            return False


def apply_operator(
    operator: Operator, operands: list[ExpressionText], x: list[NumberRange]
) -> ExpressionText:
    """Return the text of an operator applied to operands with the ranges `x`."""
    depth = 1 + max(o.depth for o in operands)
    text, binding = _applied(operator, operands, x)
    return ExpressionText(text, binding, depth)


def _applied(operator: Operator, o: list[ExpressionText], x: list[NumberRange]) -> tuple[str, Precedence]:
    match operator:
        case Operator.NOT:
            return f"not {o[0].inside(Precedence.NOT)}", Precedence.NOT
        case Operator.AND:
            return " and ".join(p.inside(Precedence.AND) for p in o), Precedence.AND
        case Operator.OR:
            return " or ".join(p.inside(Precedence.OR) for p in o), Precedence.OR
        case Operator.SELECT:
            condition, yes = o[0].inside(Precedence.OR), o[1].inside(Precedence.OR)
            return f"{yes} if {condition} else {o[2].inside(Precedence.CONDITIONAL)}", Precedence.CONDITIONAL
        case Operator.NEGATE:
            return f"-{o[0].inside(Precedence.ATOM)}", Precedence.SIGN
        case Operator.SUM:
            return _sum(o)
        case Operator.COUNT:
            return f"float({' + '.join(p.inside(Precedence.PRODUCT) for p in o)})", Precedence.ATOM
        case Operator.SECONDS:
            return f"{o[0].inside(Precedence.PRODUCT)} / 1e9", Precedence.PRODUCT
        case Operator.MIN | Operator.MAX:
            return _extreme(operator, o, x)
        case Operator.SQRT if x[0].low >= 0.0:
            return f"sqrt({o[0].text})", Precedence.ATOM
        case Operator.DIVIDE if not x[1].nonzero:
            return _guarded_quotient(o)
        case _ if operator in _INFIX and not (operator is Operator.MODULO and not x[1].nonzero):
            sign, binding = _INFIX[operator]
            left = o[0].inside(binding + 1 if binding is Precedence.COMPARISON else binding)
            return f"{left} {sign} {o[1].inside(binding + 1)}", binding
        case _:
            return _call(operator, o)


def _sum(o: list[ExpressionText]) -> tuple[str, Precedence]:
    if len(o) == 1:
        return o[0].text, o[0].binding
    first, *rest = o
    terms = [first.inside(Precedence.SUM), *[p.inside(Precedence.PRODUCT) for p in rest]]
    return " + ".join(terms), Precedence.SUM


def _guarded_quotient(o: list[ExpressionText]) -> tuple[str, Precedence]:
    """Return the text of a division whose divisor may be zero; that case is left to a call."""
    call = f"divide({o[0].text}, {o[1].text})"
    quotient = f"{o[0].inside(Precedence.PRODUCT)} / {o[1].inside(Precedence.SIGN)}"
    return f"{quotient} if {o[1].inside(Precedence.OR)} else {call}", Precedence.CONDITIONAL


def _call(operator: Operator, o: list[ExpressionText]) -> tuple[str, Precedence]:
    return f"{_CALLS[operator]}({', '.join(p.text for p in o)})", Precedence.ATOM


def _extreme(operator: Operator, o: list[ExpressionText], x: list[NumberRange]) -> tuple[str, Precedence]:
    """Return the text of a minimum or maximum; without NaN, Python's functions return the same operand."""
    if any(r.nan for r in x):
        return _call(operator, o)
    if len(o) == 1:
        return o[0].text, o[0].binding
    if len(o) == 2:
        sign = "<" if operator is Operator.MIN else ">"
        first, second = (p.inside(Precedence.SUM) for p in o)
        return f"{second} if {second} {sign} {first} else {first}", Precedence.CONDITIONAL
    return f"{operator.value}({', '.join(p.text for p in o)})", Precedence.ATOM
