"""Ops as Python: the same values, and no more parentheses than are needed."""

from __future__ import annotations

import math
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.compile.backends.python.text import (
    ANYTHING,
    ExpressionText,
    NumberRange,
    Precedence,
    apply_operator,
    literal,
    mentions_twice,
)
from colony.execute import arithmetic
from colony.execute.operators import FUNCTIONS, Operator

NAMESPACE = {name: value for module in (math, arithmetic) for name, value in vars(module).items()}
PLAIN, POSITIVE, ZERO = (
    NumberRange(-9.0, 9.0, False),
    NumberRange(1.0, 9.0, False),
    NumberRange(0.0, 9.0, False),
)


@pytest.mark.parametrize(
    ("value", "text", "binding"),
    [
        (1.5, "1.5", Precedence.ATOM),
        (-1.5, "-1.5", Precedence.SIGN),
        (-0.0, "-0.0", Precedence.SIGN),
        (math.inf, "inf", Precedence.ATOM),
        (-math.inf, "-inf", Precedence.SIGN),
        (math.nan, "nan", Precedence.ATOM),
        (1e300, "1e+300", Precedence.ATOM),
        (True, "True", Precedence.ATOM),
        (50_000_000, "50_000_000", Precedence.ATOM),
        (-1000, "-1_000", Precedence.SIGN),
    ],
)
def test_constants(value: float | bool | int, text: str, binding: Precedence) -> None:
    assert literal(value) == ExpressionText(text, binding, 0)


@pytest.mark.parametrize("inner", list(Precedence))
@pytest.mark.parametrize("outer", list(Precedence))
def test_parentheses_where_it_binds_less_tightly(inner: Precedence, outer: Precedence) -> None:
    assert ExpressionText("x", inner).inside(outer) == ("x" if inner >= outer else "(x)")


@pytest.mark.parametrize(
    ("operator", "x", "twice"),
    [
        (Operator.MIN, (PLAIN, PLAIN), True),
        (Operator.MAX, (PLAIN, PLAIN), True),
        (Operator.MIN, (PLAIN,), False),
        (Operator.MIN, (PLAIN, PLAIN, PLAIN), False),
        (Operator.MAX, (PLAIN, ANYTHING), False),
        (Operator.DIVIDE, (PLAIN, PLAIN), True),
        (Operator.DIVIDE, (PLAIN, ZERO), True),
        (Operator.DIVIDE, (PLAIN, POSITIVE), False),
        (Operator.ADD, (PLAIN, PLAIN), False),
        (Operator.MODULO, (PLAIN, PLAIN), False),
    ],
)
def test_operands_that_stand_twice(operator: Operator, x: tuple[NumberRange, ...], twice: bool) -> None:
    assert mentions_twice(operator, list(x)) is twice


def test_how_deep_it_nests() -> None:
    deep = ExpressionText("x", Precedence.SUM, 4)
    assert apply_operator(Operator.ADD, [ExpressionText("a"), deep], [PLAIN, PLAIN]) == ExpressionText(
        "a + (x)", Precedence.SUM, 5
    )
    assert apply_operator(Operator.NEGATE, [ExpressionText("a")], [PLAIN]) == ExpressionText(
        "-a", Precedence.SIGN, 1
    )
    assert apply_operator(Operator.MULTIPLY, [deep, ExpressionText("b")], [PLAIN, PLAIN]).depth == 5


@pytest.mark.parametrize(
    ("operator", "x", "text"),
    [
        (Operator.SQRT, (POSITIVE,), "sqrt(a)"),
        (Operator.SQRT, (ZERO,), "sqrt(a)"),
        (Operator.SQRT, (PLAIN,), "square_root(a)"),
        (Operator.SIN, (PLAIN,), "sine(a)"),
        (Operator.COS, (ANYTHING,), "cosine(a)"),
        (Operator.DIVIDE, (PLAIN, POSITIVE), "a / b"),
        (Operator.DIVIDE, (PLAIN, ZERO), "a / b if b else divide(a, b)"),
        (Operator.MODULO, (PLAIN, POSITIVE), "a % b"),
        (Operator.MODULO, (POSITIVE, ZERO), "modulo(a, b)"),
        (Operator.SUM, (PLAIN,), "a"),
        (Operator.SUM, (PLAIN, PLAIN), "a + b"),
        (Operator.MIN, (PLAIN,), "a"),
        (Operator.MIN, (PLAIN, PLAIN), "b if b < a else a"),
        (Operator.MAX, (PLAIN, PLAIN), "b if b > a else a"),
        (Operator.MAX, (PLAIN, PLAIN, PLAIN), "max(a, b, c)"),
        (Operator.MIN, (PLAIN, ANYTHING, PLAIN), "minimum(a, b, c)"),
        (Operator.COUNT, (ANYTHING, ANYTHING), "float(a + b)"),
        (Operator.SECONDS, (ANYTHING,), "a / 1e9"),
    ],
)
def test_the_plainest_that_is_right(operator: Operator, x: tuple[NumberRange, ...], text: str) -> None:
    assert apply_operator(operator, [ExpressionText(name) for name in "abc"[: len(x)]], list(x)).text == text


# --- the same values -----------------------------------------------------------------------------

ONE = (Operator.NEGATE, Operator.ABS, Operator.SIGN, Operator.SQRT, Operator.FLOOR, Operator.CEIL)
TWO = (
    *(Operator.ADD, Operator.SUBTRACT, Operator.MULTIPLY, Operator.DIVIDE, Operator.MODULO),
    *(Operator.LESS, Operator.LESS_EQUAL, Operator.EQUAL, Operator.NOT_EQUAL, Operator.MIN, Operator.MAX),
)
LOGIC = (Operator.AND, Operator.OR)
NUMBERS = (0.0, -0.0, 1.0, -2.5, 3.0, math.inf, -math.inf, math.nan)


@st.composite
def expressions(draw: st.DrawFn, depth: int = 4) -> tuple[ExpressionText, float | bool]:
    """An expression over constants, with its value."""
    if depth == 0 or draw(st.integers(0, 5)) == 0:
        value = draw(st.sampled_from(NUMBERS))
        return literal(value), value
    operator = draw(st.sampled_from((*ONE, *TWO, Operator.SELECT, Operator.NOT, *LOGIC)))
    count = 1 if operator in (*ONE, Operator.NOT) else 3 if operator is Operator.SELECT else 2
    parts = [draw(expressions(depth=depth - 1)) for _ in range(count)]
    if operator in (Operator.NOT, *LOGIC):
        parts = [_as_bool(part) for part in parts]
    elif operator is Operator.SELECT:
        parts[0] = _as_bool(parts[0])
    else:
        parts = [_as_number(part) for part in parts]
    value = FUNCTIONS[operator](*(value for _, value in parts))
    return apply_operator(operator, [text for text, _ in parts], [_range(value) for _, value in parts]), value


def _as_bool(part: tuple[ExpressionText, float | bool]) -> tuple[ExpressionText, float | bool]:
    text, value = part
    if isinstance(value, bool):
        return part
    return apply_operator(Operator.EQUAL, [text, text], [_range(value)] * 2), value == value


def _as_number(part: tuple[ExpressionText, float | bool]) -> tuple[ExpressionText, float | bool]:
    text, value = part
    if not isinstance(value, bool):
        return part
    return apply_operator(
        Operator.SELECT, [text, literal(2.0), literal(-3.0)], [ANYTHING] * 3
    ), 2.0 if value else -3.0


def _range(value: float | bool) -> NumberRange:
    return ANYTHING if isinstance(value, bool) or value != value else NumberRange(value, value, False)


@given(expressions())
def test_an_expression_has_the_value_of_its_ops(drawn: tuple[ExpressionText, float | bool]) -> None:
    text, value = drawn
    assert repr(eval(text.text, dict(NAMESPACE))) == repr(value), text.text


def test_two_operators_beside_each_other() -> None:
    for outer, inner in product(TWO, TWO):
        for left in (True, False):
            a, b, c = 7.0, 2.0, -3.0
            within = _as_number(
                (
                    apply_operator(inner, [literal(a), literal(b)], [_range(a), _range(b)]),
                    FUNCTIONS[inner](a, b),
                )
            )
            parts = [within, (literal(c), c)] if left else [(literal(c), c), within]
            text = apply_operator(outer, [t for t, _ in parts], [_range(v) for _, v in parts]).text
            assert repr(eval(text, dict(NAMESPACE))) == repr(FUNCTIONS[outer](*(v for _, v in parts))), text
