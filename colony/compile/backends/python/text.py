"""Ops as Python expressions, with no more parentheses than are needed.

Where NaN and division by zero are impossible, Python's own operators and functions are used, elsewhere those
of `colony.execute.arithmetic`.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from colony.compile.backends.python.ranges import Range
from colony.execute.operators import Operator


class Binding(IntEnum):
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


class Text(NamedTuple):
    """The text of an expression; `depth` is its nesting depth, which Python's parser limits."""

    text: str
    binding: Binding = Binding.ATOM
    depth: int = 0

    def inside(self, binding: int) -> str:
        """Return the text as an operand that must bind at least as tightly as `binding`."""
        return self.text if self.binding >= binding else f"({self.text})"


TRUE = Text("True")

_INFIX: dict[Operator, tuple[str, Binding]] = {
    Operator.ADD: ("+", Binding.SUM),
    Operator.SUBTRACT: ("-", Binding.SUM),
    Operator.TIME_ADD: ("+", Binding.SUM),
    Operator.TIME_SUBTRACT: ("-", Binding.SUM),
    Operator.MULTIPLY: ("*", Binding.PRODUCT),
    Operator.DIVIDE: ("/", Binding.PRODUCT),
    Operator.MODULO: ("%", Binding.PRODUCT),
    Operator.LESS: ("<", Binding.COMPARISON),
    Operator.TIME_LESS: ("<", Binding.COMPARISON),
    Operator.LESS_EQUAL: ("<=", Binding.COMPARISON),
    Operator.EQUAL: ("==", Binding.COMPARISON),
    Operator.NOT_EQUAL: ("!=", Binding.COMPARISON),
}

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


def literal(value: float | bool | int) -> Text:
    """Return a constant; NaN and infinity are written by their names in `math`."""
    if isinstance(value, bool):
        return Text(repr(value))
    if isinstance(value, int):
        text = f"{value:_}"
    else:
        text = repr(value)
    return Text(text, Binding.SIGN if text.startswith("-") else Binding.ATOM)


def mentions_twice(operator: Operator, x: list[Range]) -> bool:
    """Return True if the operator's text repeats its operands, so that these should be variables."""
    match operator:
        case Operator.MIN | Operator.MAX:
            return len(x) == 2 and not any(r.nan for r in x)
        case Operator.DIVIDE:
            return not x[1].nonzero
        case _:
            return False


def apply_operator(operator: Operator, operands: list[Text], x: list[Range]) -> Text:
    """Return the text of an operator applied to operands with the ranges `x`."""
    depth = 1 + max(o.depth for o in operands)
    text, binding = _applied(operator, operands, x)
    return Text(text, binding, depth)


def _applied(operator: Operator, o: list[Text], x: list[Range]) -> tuple[str, Binding]:
    match operator:
        case Operator.NOT:
            return f"not {o[0].inside(Binding.NOT)}", Binding.NOT
        case Operator.AND:
            return " and ".join(p.inside(Binding.AND) for p in o), Binding.AND
        case Operator.OR:
            return " or ".join(p.inside(Binding.OR) for p in o), Binding.OR
        case Operator.SELECT:
            condition, yes = o[0].inside(Binding.OR), o[1].inside(Binding.OR)
            return f"{yes} if {condition} else {o[2].inside(Binding.CONDITIONAL)}", Binding.CONDITIONAL
        case Operator.NEGATE:
            return f"-{o[0].inside(Binding.ATOM)}", Binding.SIGN
        case Operator.SUM:
            return _sum(o)
        case Operator.COUNT:
            return f"float({' + '.join(p.inside(Binding.PRODUCT) for p in o)})", Binding.ATOM
        case Operator.SECONDS:
            return f"{o[0].inside(Binding.PRODUCT)} / 1e9", Binding.PRODUCT
        case Operator.MIN | Operator.MAX:
            return _extreme(operator, o, x)
        case Operator.SQRT if x[0].low >= 0.0:
            return f"sqrt({o[0].text})", Binding.ATOM
        case Operator.DIVIDE if not x[1].nonzero:
            return _guarded_quotient(o)
        case _ if operator in _INFIX and not (operator is Operator.MODULO and not x[1].nonzero):
            sign, binding = _INFIX[operator]
            left = o[0].inside(binding + 1 if binding is Binding.COMPARISON else binding)
            return f"{left} {sign} {o[1].inside(binding + 1)}", binding
        case _:
            return _call(operator, o)


def _sum(o: list[Text]) -> tuple[str, Binding]:
    if len(o) == 1:
        return o[0].text, o[0].binding
    first, *rest = o
    terms = [first.inside(Binding.SUM), *[p.inside(Binding.PRODUCT) for p in rest]]
    return " + ".join(terms), Binding.SUM


def _guarded_quotient(o: list[Text]) -> tuple[str, Binding]:
    """Return the text of a division whose divisor may be zero; that case is left to a call."""
    call = f"divide({o[0].text}, {o[1].text})"
    quotient = f"{o[0].inside(Binding.PRODUCT)} / {o[1].inside(Binding.SIGN)}"
    return f"{quotient} if {o[1].inside(Binding.OR)} else {call}", Binding.CONDITIONAL


def _call(operator: Operator, o: list[Text]) -> tuple[str, Binding]:
    return f"{_CALLS[operator]}({', '.join(p.text for p in o)})", Binding.ATOM


def _extreme(operator: Operator, o: list[Text], x: list[Range]) -> tuple[str, Binding]:
    """Return the text of a minimum or maximum; without NaN, Python's functions return the same operand."""
    if any(r.nan for r in x):
        return _call(operator, o)
    if len(o) == 1:
        return o[0].text, o[0].binding
    if len(o) == 2:
        sign = "<" if operator is Operator.MIN else ">"
        first, second = (p.inside(Binding.SUM) for p in o)
        return f"{second} if {second} {sign} {first} else {first}", Binding.CONDITIONAL
    return f"{operator.value}({', '.join(p.text for p in o)})", Binding.ATOM
