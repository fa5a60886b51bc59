"""Code as data: what is live, renumbering, and what each operator computes."""

from __future__ import annotations

from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.execute.code import (
    Apply,
    Cell,
    FrameTime,
    Kind,
    Literal,
    OldCell,
    SensorElement,
    SensorFresh,
    Table,
    live,
    operands,
    remapped,
)
from colony.execute.machine import INLINE
from colony.execute.operators import FUNCTIONS, Operator

OPS = (
    Literal(1.0),
    OldCell(1),
    Apply(Operator.ADD, (0, 1)),
    SensorFresh("s"),
    SensorElement("s", 0),
    OldCell(0),
    Apply(Operator.ADD, (4, 5)),
    Table((0, 2)),
    FrameTime(),
)
CELLS = (
    Cell(name="a", kind=Kind.NUMBER, initial=0.0, condition=3, value=2),
    Cell(name="b", kind=Kind.NUMBER, initial=0.0, condition=3, value=4),
)


def _live(*wanted: int) -> tuple[list[int], set[int]]:
    flags, cells = live(OPS, CELLS, wanted)
    return [i for i, flag in enumerate(flags) if flag], cells


def test_a_cell_that_is_read_needs_what_it_takes() -> None:
    assert _live(0) == ([0], set())
    assert _live(2) == ([0, 1, 2, 3, 4], {1})
    assert _live(6) == ([0, 1, 2, 3, 4, 5, 6], {0, 1})
    assert _live(7)[0] == [0, 1, 2, 3, 4, 7]


def test_operands() -> None:
    assert operands(OPS[2]) == (0, 1)
    assert operands(OPS[7]) == (0, 2)
    assert operands(OPS[4]) == ()


def test_renumbering() -> None:
    number = {i: i + 10 for i in range(len(OPS))}
    assert remapped(OPS[2], number, {}) == Apply(Operator.ADD, (10, 11))
    assert remapped(OPS[7], number, {}) == Table((10, 12))
    assert remapped(OPS[5], number, {0: 4}) == OldCell(4)
    assert remapped(OPS[3], number, {}) is OPS[3]


def test_every_operator_has_a_function() -> None:
    assert set(FUNCTIONS) == set(Operator)


ODD = (0.0, -0.0, 1.0, -2.5, 1e308, -1e308, 5e-324, 2.0**53, inf, -inf, nan)

ONE = (
    "NEGATE",
    "ABS",
    "SIGN",
    "SQRT",
    "FLOOR",
    "CEIL",
    "ROUND",
    "SIN",
    "COS",
    "TAN",
    "ASIN",
    "ACOS",
    "FINITE",
)
TWO = ("ADD", "SUBTRACT", "MULTIPLY", "DIVIDE", "MODULO", "ATAN2", "MIN", "MAX", "SUM")
MORE = ("INDEX_OF_MIN", "INDEX_OF_MAX", "LESS", "LESS_EQUAL", "EQUAL", "NOT_EQUAL")


@pytest.mark.parametrize("name", ONE)
def test_operators_of_one_number_are_total(name: str) -> None:
    for x in ODD:
        assert isinstance(FUNCTIONS[Operator[name]](x), float | bool)


@pytest.mark.parametrize("name", TWO + MORE)
def test_operators_of_two_numbers_are_total(name: str) -> None:
    for x in ODD:
        for y in ODD:
            assert isinstance(FUNCTIONS[Operator[name]](x, y), float | bool)


def test_picking_is_total() -> None:
    for index in ODD:
        assert isinstance(FUNCTIONS[Operator.PICK_NUMBER]((1.0, 2.0, 3.0), index), float)
        assert isinstance(FUNCTIONS[Operator.PICK_BOOL]((True, False, True), index), bool)


@given(st.sampled_from(sorted(INLINE, key=lambda op: op.value)), st.data())
def test_what_is_inline_computes_what_the_functions_do(operator: Operator, drawn: st.DataObject) -> None:
    truths, numbers = st.booleans(), st.floats(allow_nan=True)
    match operator:
        case Operator.NOT:
            given_values = [drawn.draw(truths)]
        case Operator.AND | Operator.OR:
            given_values = [drawn.draw(truths), drawn.draw(truths)]
        case Operator.SELECT:
            given_values = [drawn.draw(truths), drawn.draw(numbers), drawn.draw(numbers)]
        case Operator.TIME_ADD | Operator.TIME_SUBTRACT | Operator.TIME_LESS:
            given_values = [drawn.draw(st.integers()), drawn.draw(st.integers())]
        case _:
            given_values = [drawn.draw(numbers), drawn.draw(numbers)]
    places = range(len(given_values))
    assert repr(INLINE[operator](given_values, *places)()) == repr(FUNCTIONS[operator](*given_values))
