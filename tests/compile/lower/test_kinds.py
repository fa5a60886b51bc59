"""What modules read, constants that are arrays, and the kinds of what comes from modules in Python."""

from __future__ import annotations

from dataclasses import replace

import pytest

from colony.compile.lower.lower import lower
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.code import Code, Kind, PythonActive, PythonField
from colony.execute.needs import clients_view
from colony.ir import expression as e
from colony.ir.frame import Frame
from colony.ir.program import Let
from colony.ir.types import DIMENSIONLESS, Array
from tests.executors import outcomes
from tests.programs import lowered

ROBOT = """
robot r {
  sensor x : number from DServer.x
  sensor b : bool from DServer.b
  sensor a[5] : number from DServer.a
  actuator out { v : number, on : bool } to DServer.Out idle hold
}
"""
PYTHON = f"""{ROBOT}
module p from python "tests.verify.scripted_modules:Scripted" {{ reads x commands out }}
module m {{ when b do out(v = 1, on = true) }}
network {{ out = p suppresses m }}
"""
GIVEN = {"x": 1.0, "b": True, "a": [5.0, 4.0, 3.0, 2.0, 1.0]}


def kinds(code: Code, of: type) -> list[Kind]:
    return [kind for op, kind in zip(code.ops, code.kinds, strict=True) if isinstance(op, of)]


# --- arrays ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("index", ["x", "1"])
def test_a_constant_may_be_an_array(index: str) -> None:
    text = f"{ROBOT}let t = a + 0 module m {{ when b do out(v = t[{index}], on = b) }}\nnetwork {{ out = m }}"
    program = load_text(text)
    (let,) = program.derived
    table = e.Constant(type=Array(DIMENSIONLESS, 5), value=(10.0, 20.0, 30.0, 40.0, 50.0))
    assert isinstance(let, Let)
    program = replace(program, derived=(replace(let, expression=table),))
    trace = [Frame(k, {**GIVEN, "x": x}) for k, x in enumerate((1.0, 4.0))]
    assert outcomes(program, trace)[0].decisions[0].values == (20.0, True)


# --- modules in Python -------------------------------------------------------------------------------


def test_fields_of_a_module_in_python_have_the_kinds_of_their_types() -> None:
    code = lowered(PYTHON)
    assert kinds(code, PythonField) == [Kind.NUMBER, Kind.BOOL]


def test_the_activity_of_a_module_elsewhere_is_a_truth_value() -> None:
    program = load_text(PYTHON)
    code = clients_view(lower(program, compile_program(program).clients).code, [("out", "m")])
    assert kinds(code, PythonActive) == [Kind.BOOL]
