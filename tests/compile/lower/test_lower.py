"""Lowering: what is shared, what is left out, what a client alone needs, and that nothing recurses."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.compile.lower.lower import lower
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.code import Apply, Code, Kind, Literal, OldCell, PythonActive, SensorFresh, operands
from colony.execute.executor import ProgramExecutor
from colony.execute.needs import clients_view
from colony.execute.operators import Operator
from colony.ir.expression import (
    NESTING_LIMIT,
    Binary,
    BinaryOperation,
    Constant,
    DerivedValue,
    Expression,
    LocalValue,
    SensorValue,
)
from colony.ir.frame import Frame
from colony.ir.program import (
    Actuator,
    ActuatorField,
    Let,
    Module,
    Program,
    Robot,
    Sensor,
    TransferFunction,
    Use,
    Wire,
)
from colony.ir.types import BOOL, DIMENSIONLESS
from tests.drawn.strategies import programs
from tests.networks import chain, random_program
from tests.programs import lowered


def _count(code: Code, operator: Operator) -> int:
    return sum(1 for op in code.ops if isinstance(op, Apply) and op.operator is operator)


ROBOT = """
robot r {
  sensor x : number from DServer.x
  sensor y : number from DServer.y
  sensor a[4] : number from DServer.a
  actuator out { v : number } to DServer.Out idle hold
}
"""


@given(data=st.data())
def test_code_is_in_order(data: st.DataObject) -> None:
    """Operands stand before what uses them; nothing before `decided` depends on a decision."""
    code = lowered(data.draw(programs()))
    assert len(code.ops) == len(code.kinds)
    assert len({cell.name for cell in code.cells}) == len(code.cells)
    depends = set()
    for at, op in enumerate(code.ops):
        assert all(i < at for i in operands(op))
        if type(op).__name__ in ("Winner", "Commanded", "Sent") or depends.intersection(operands(op)):
            depends.add(at)
            assert at >= code.decided
    for cell in code.cells:
        assert code.kinds[cell.condition] is Kind.BOOL
        assert code.kinds[cell.value] is cell.kind
    calls = [at for at, op in enumerate(code.ops) if isinstance(op, PythonActive)]
    reads = [i for call in code.python for read in call.reads for i in read.elements]
    assert not calls or max(reads) < min(calls)


def test_equal_things_stand_once() -> None:
    code = lowered(
        ROBOT
        + """
let sum_ = x + y
module one { when x + y > 1  do out(v = sum_ * 2) }
module two { when x + y > 1 and x + y < 9  do out(v = (x + y) * 2) }
network { out = one suppresses two }
"""
    )
    assert _count(code, Operator.ADD) == 1
    assert _count(code, Operator.MULTIPLY) == 1
    assert sum(1 for op in code.ops if isinstance(op, SensorFresh)) == 2


def test_zeros_of_either_sign_are_two() -> None:
    code = lowered(
        ROBOT + "module m { when x > 0  do out(v = if y > 0 then 0 * 1 else -0 * 1) }\nnetwork { out = m }"
    )
    zeros = [
        op.value for op in code.ops if isinstance(op, Literal) and op.value == 0 and op.value is not False
    ]
    assert sorted(map(repr, zeros)) == ["-0.0", "0.0"]


def test_constants_are_folded() -> None:
    code = lowered(ROBOT + "module m { when true  do out(v = x + min(3, 1 + 1)) }\nnetwork { out = m }")
    numbers = [op.value for op in code.ops if isinstance(op, Literal) and not isinstance(op.value, bool)]
    assert numbers == [2.0]


def test_what_nothing_needs_is_left_out() -> None:
    code = lowered(
        ROBOT
        + """
let unused = previous(x, 0) + y
state forgotten = 0
next forgotten = forgotten + y
module m { when x > 0  do out(v = x) }
network { out = m }
"""
    )
    assert code.cells == ()
    assert [s.name for s in code.sensors] == ["x", "y", "a"]  # all are taken in, for what has to be recorded


def test_one_frame_counter_for_all_memory_of_one_module() -> None:
    code = lowered(
        ROBOT + "module m { when changed(x) or changed(y)  do out(v = captured(x, y)) }\nnetwork { out = m }"
    )
    assert sum(1 for cell in code.cells if cell.name.startswith("started")) == 1


SHARED = (
    ROBOT
    + """
let recent = previous(y, 0)
module big { when x > 0  do out(v = sum(a) * recent) }
module small { when x < 0  do out(v = x) }
network { out = big suppresses small }
limit out.v <= 5 when recent > 2
contract c: previous(out.v, 0) < 9
"""
)


def test_a_client_alone() -> None:
    program = load_text(SHARED)
    clients = compile_program(program).clients
    big, small = (clients_view(lower(program, clients).code, [("out", m)]) for m in ("big", "small"))
    assert _count(big, Operator.SUM) == 1
    assert _count(small, Operator.SUM) == 0
    for code in (big, small):
        assert len(code.actuators) == 1
        assert len(code.actuators[0].clients) == 1
        assert len(code.actuators[0].limits) == 1
        assert (len(code.cells), code.contracts) == (1, ())
        (client,) = code.actuators[0].clients
        assert client.guard == client.active
        assert (client.exclusive == client.guard) is (client.module == "big")
    assert [c.priority for c in (big.actuators[0].clients[0], small.actuators[0].clients[0])] == [2, 1]


def test_no_such_client() -> None:
    program = load_text(SHARED)
    clients = compile_program(program).clients
    with pytest.raises(KeyError):
        clients_view(lower(program, clients).code, [("out", "none")])
    with pytest.raises(KeyError):
        clients_view(lower(program, clients).code, [("none", "big")])


def test_big_arrays_stand_as_their_elements_once() -> None:
    modules = "".join(
        f"module m{i} {{ when big[{i}] < 1 and big[x] > 2  do out(v = big[{i + 1}]) }}\n" for i in range(200)
    )
    wiring = " suppresses ".join(f"m{i}" for i in range(200))
    text = ROBOT.replace("sensor y", "sensor big[1000] : number from DServer.big\n  sensor y")
    code = lowered(text + modules + f"network {{ out = {wiring} }}")
    assert len(code.ops) < 4000


# --- size and depth ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "make", [lambda n: chain(n), lambda n: random_program(n, 3)], ids=["chain", "random"]
)
def test_size_is_near_linear(make) -> None:
    sizes = []
    for n in (200, 2000):
        code = lowered(make(n))
        sizes.append(sum(1 + len(operands(op)) for op in code.ops))
    assert sizes[1] < 13 * sizes[0]


def _out(expression: Expression, lets: tuple[Let, ...] = (), local: tuple[Let, ...] = ()) -> Program:
    """A program of one module that commands `expression`."""
    fields = (ActuatorField(name="v", type=DIMENSIONLESS),)
    actuator = Actuator(name="out", fields=fields, server="DServer", command="Out", idle=None)
    sensor = Sensor(name="x", type=DIMENSIONLESS, server="DServer", field="x")
    module = Module(
        name="m",
        lets=local,
        when=Constant(type=BOOL, value=True),
        command=TransferFunction(actuator="out", fields=(expression,)),
    )
    return Program(
        robot=Robot(name="r", sensors=(sensor,), actuators=(actuator,)),
        derived=lets,
        modules=(module,),
        wires=(Wire(name="out", wiring=Use(name="m"), actuator="out"),),
    )


X = SensorValue(type=DIMENSIONLESS, name="x")


def _plus_one(expression: Expression) -> Expression:
    return BinaryOperation(
        type=DIMENSIONLESS,
        operator=Binary.ADD,
        left=expression,
        right=Constant(type=DIMENSIONLESS, value=1.0),
    )


def _sent(program: Program) -> float:
    executor = ProgramExecutor(compile_program(program).compiled)
    (decision,) = executor.step(Frame(0, {"x": 1.0})).decisions
    return decision.values[0]


def test_the_deepest_expression() -> None:
    e: Expression = X
    for _ in range(NESTING_LIMIT - 1):
        e = _plus_one(e)
    assert _sent(_out(e)) == NESTING_LIMIT


def test_long_chains_of_lets() -> None:
    n = 5000
    lets = [Let(name="g0", expression=X)]
    lets += [
        Let(name=f"g{i}", expression=_plus_one(DerivedValue(type=DIMENSIONLESS, name=f"g{i - 1}")))
        for i in range(1, n)
    ]
    assert _sent(_out(DerivedValue(type=DIMENSIONLESS, name=f"g{n - 1}"), lets=tuple(lets))) == n
    local = [Let(name="m.g0", expression=X)]
    local += [
        Let(name=f"m.g{i}", expression=_plus_one(LocalValue(type=DIMENSIONLESS, name=f"m.g{i - 1}")))
        for i in range(1, n)
    ]
    assert _sent(_out(LocalValue(type=DIMENSIONLESS, name=f"m.g{n - 1}"), local=tuple(local))) == n


def test_old_cells_are_the_only_way_to_memory() -> None:
    code = lowered(SHARED)
    read = {op.cell for op in code.ops if isinstance(op, OldCell)}
    assert read == set(range(len(code.cells)))
