"""Equal ops have one number, constants are folded, and what nothing needs is left out."""

from __future__ import annotations

import math

import pytest

from colony.compile.guards import ActuatorClients, Client, ClientList, ModuleActive, Not
from colony.compile.lower.builder import CodeBuilder
from colony.compile.passes.simplify import simplify
from colony.execute.code import Apply, FrameTime, Kind, Literal, SensorElement, SensorFresh
from colony.execute.operators import FUNCTIONS, Operator

BOOLS = {
    *(Operator.LESS, Operator.LESS_EQUAL, Operator.EQUAL, Operator.NOT_EQUAL, Operator.FINITE),
    *(Operator.NOT, Operator.AND, Operator.OR, Operator.PICK_BOOL, Operator.TIME_LESS),
}
TIMES = {Operator.TIME_ADD, Operator.TIME_SUBTRACT}
OF_TIMES = {*TIMES, Operator.TIME_LESS, Operator.SECONDS}
OF_BOOLS = {Operator.NOT, Operator.AND, Operator.OR, Operator.COUNT}
ONE = {
    *(Operator.NEGATE, Operator.ABS, Operator.SIGN, Operator.SQRT, Operator.FLOOR, Operator.CEIL),
    *(
        Operator.ROUND,
        Operator.SIN,
        Operator.COS,
        Operator.TAN,
        Operator.ASIN,
        Operator.ACOS,
        Operator.FINITE,
        Operator.NOT,
        Operator.SECONDS,
    ),
}
PICKING = {Operator.PICK_NUMBER, Operator.PICK_BOOL}


def kind_of(operator: Operator) -> Kind:
    return Kind.BOOL if operator in BOOLS else Kind.TIME if operator in TIMES else Kind.NUMBER


def arguments(operator: Operator) -> list[float | int | bool]:
    if operator in OF_TIMES:
        values: list[float | int | bool] = [7_000_000_000, 3]
    else:
        values = [True, False] if operator in OF_BOOLS else [6.5, 2.0]
    return values[:1] if operator in ONE else values


def literal(builder: CodeBuilder, operator: Operator, value: float | int | bool) -> int:
    return builder.time(int(value)) if operator in OF_TIMES else builder.literal(value)


PLAIN = [operator for operator in Operator if operator not in PICKING and operator is not Operator.SELECT]


@pytest.mark.parametrize("operator", PLAIN, ids=lambda o: o.value)
def test_constants_are_folded(operator: Operator) -> None:
    builder, values = CodeBuilder(), arguments(operator)
    at = builder.apply(operator, *(literal(builder, operator, value) for value in values))
    expected = FUNCTIONS[operator](*values)
    op = builder.ops[at]
    assert isinstance(op, Literal)
    assert (repr(op.value), builder.kinds[at]) == (repr(expected), kind_of(operator))


@pytest.mark.parametrize("operator", PLAIN, ids=lambda o: o.value)
def test_what_is_not_constant_is_computed(operator: Operator) -> None:
    builder = CodeBuilder()
    x = builder.add(FrameTime(), Kind.TIME)
    for place in range(len(arguments(operator))):
        operands = [literal(builder, operator, value) for value in arguments(operator)]
        operands[place] = x
        at = builder.apply(operator, *operands)
        assert builder.ops[at] == Apply(operator, tuple(operands))
        assert builder.kinds[at] is kind_of(operator)
        assert builder.apply(operator, *operands) == at


def test_picking_is_of_the_kind_of_the_table() -> None:
    builder = CodeBuilder()
    index = builder.add(SensorElement("x", 0), Kind.NUMBER)
    for operator, value, kind in (
        (Operator.PICK_NUMBER, 1.0, Kind.NUMBER),
        (Operator.PICK_BOOL, True, Kind.BOOL),
    ):
        table = builder.table((builder.literal(value),) * 2)
        assert builder.kinds[table] is Kind.TABLE
        assert builder.kinds[builder.apply(operator, table, index)] is kind


def test_constants_that_differ_are_not_one() -> None:
    builder = CodeBuilder()
    made = [builder.literal(0.0), builder.literal(-0.0), builder.literal(False), builder.time(0)]
    made += [builder.literal(1.0), builder.literal(True), builder.time(1)]
    assert len(set(made)) == len(made) == len(builder.ops)
    assert [builder.kinds[i].value for i in made] == [*"number number bool time number bool time".split()]
    assert builder.literal(1) == builder.literal(1.0)
    assert isinstance(builder.ops[builder.literal(2)].value, float)  # type: ignore[union-attr]
    assert builder.literal(math.nan) == builder.literal(math.nan)


def test_choices() -> None:
    builder = CodeBuilder()
    b = builder.add(SensorElement("b", 0), Kind.BOOL)
    x, y = (builder.add(SensorElement(name, 0), Kind.NUMBER) for name in "xy")
    yes, no = builder.literal(True), builder.literal(False)
    select = Operator.SELECT
    assert [builder.apply(select, c, x, y) for c in (yes, no)] == [x, y]
    assert builder.apply(select, b, x, x) == x
    at = builder.apply(select, b, x, y)
    assert (builder.ops[at], builder.kinds[at]) == (Apply(select, (b, x, y)), Kind.NUMBER)
    assert builder.kinds[builder.apply(select, b, yes, b)] is Kind.BOOL
    now = builder.add(FrameTime(), Kind.TIME)
    assert builder.kinds[builder.apply(select, b, now, builder.time(0))] is Kind.TIME


def test_conjunctions_and_disjunctions() -> None:
    builder = CodeBuilder()
    a, b = (builder.add(SensorFresh(name), Kind.BOOL) for name in "ab")
    yes, no = builder.literal(True), builder.literal(False)
    assert (builder.both(), builder.either()) == (yes, no)
    assert (builder.both(a), builder.either(a)) == (a, a)
    assert (builder.both(a, yes, a), builder.either(no, a, a)) == (a, a)
    assert (builder.both(a, no, b), builder.either(yes, a)) == (no, yes)
    assert (builder.both(yes, yes), builder.either(no)) == (yes, no)
    at = builder.both(b, yes, a, b)
    assert (builder.ops[at], builder.kinds[at]) == (Apply(Operator.AND, (b, a)), Kind.BOOL)
    at = builder.either(a, no, b)
    assert (builder.ops[at], builder.kinds[at]) == (Apply(Operator.OR, (a, b)), Kind.BOOL)


def test_negations() -> None:
    builder = CodeBuilder()
    a = builder.add(SensorFresh("a"), Kind.BOOL)
    not_a = builder.negation(a)
    assert builder.ops[not_a] == Apply(Operator.NOT, (a,))
    assert builder.negation(not_a) == a
    assert builder.negation(builder.literal(True)) == builder.literal(False)
    either = builder.either(a, not_a)
    assert builder.ops[builder.negation(either)] == Apply(Operator.NOT, (either,))


def test_what_is_true() -> None:
    builder = CodeBuilder()
    a = builder.add(SensorFresh("a"), Kind.BOOL)
    values = (builder.literal(True), builder.literal(False), a, builder.literal(1.0), builder.time(1))
    assert [builder.is_true(value) for value in values] == [True, False, False, False, False]


def test_a_cell_is_made_once_and_takes_nothing_until_it_is_said_what() -> None:
    builder = CodeBuilder()
    old, other = builder.cell("a", Kind.NUMBER, 2.5), builder.cell("b", Kind.TIME, 7)
    assert builder.cell("a", Kind.NUMBER, 9.0) == old != other
    a, b = builder.cells()
    never = builder.literal(False)
    assert (a.name, a.kind, a.initial, a.condition, a.value) == ("a", Kind.NUMBER, 2.5, never, never)
    assert (b.name, b.kind, b.initial) == ("b", Kind.TIME, 7)
    condition, value = builder.literal(True), builder.literal(4.0)
    builder.keep(old, condition, value)
    a, b = builder.cells()
    assert (a.condition, a.value, b.condition) == (condition, value, never)
    assert [builder.kinds[i] for i in (old, other)] == [Kind.NUMBER, Kind.TIME]


def test_the_first_guards_of_a_table_count_too() -> None:
    """A negation in the second place needs what stands in the first, though nothing else does."""
    guards = (ModuleActive("a"), Not(0))
    client = Client(module="m", priority=1, guard=1, exclusive=1)
    simpler = simplify(
        ClientList(guards=guards, actuators=(ActuatorClients(actuator="x", clients=(client,)),))
    )
    (one,) = simpler.actuators[0].clients
    assert simpler.guards == guards
    assert (one.guard, one.exclusive) == (1, 1)
