"""What modules read, constants that are arrays, and the kinds of what comes from modules in Python."""

from __future__ import annotations

from dataclasses import replace

import pytest

from colony.compile.backends.python.generate import generate, load
from colony.compile.lower.lower import lower, lower_client
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.code import Code, Kind, OutsideActive, PythonField
from colony.execute.executor import ClientListExecutor
from colony.ir import expression as e
from colony.ir.frame import Frame
from colony.ir.program import Let, Program
from colony.ir.types import PLAIN, Array, Value
from colony.verify.reference.interpreter import Interpreter

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


def sent(program: Program, *readings: dict[str, object]) -> list[Value | None]:
    """What goes to `out` in each frame, the same from the interpreter, the executor and generated Python."""
    clients = compile_program(program).clients
    executors = Interpreter(program), ClientListExecutor(program, clients), load(generate(program, clients))
    found = []
    for executor in executors:
        frames = [Frame(k * 50_000_000, given) for k, given in enumerate(readings)]  # type: ignore[arg-type]
        found.append([executor.step(frame).decisions[0].values for frame in frames])
    assert found[0] == found[1] == found[2]
    return list(found[0])


def kinds(code: Code, of: type) -> list[Kind]:
    return [kind for op, kind in zip(code.ops, code.kinds, strict=True) if isinstance(op, of)]


# --- what modules read -------------------------------------------------------------------------------


def test_a_module_needs_what_only_its_state_reads() -> None:
    text = f"{ROBOT}module m {{ state s = 0 state t = 7 next s = s + x when b do out(v = s + t, on = b) }}"
    program = load_text(f"{text}\nnetwork {{ out = m }}")
    there, gone = GIVEN, {**GIVEN, "x": None}
    assert sent(program, there, gone, there, there) == [(7.0, True), None, (8.0, True), (9.0, True)]


def test_a_state_reads_lets_that_nothing_else_reads() -> None:
    text = (
        f"{ROBOT}let twice = 2 * x state s = 0 next s = s + twice module m {{ when b do out(v = s, on = b) }}"
    )
    assert sent(load_text(f"{text}\nnetwork {{ out = m }}"), GIVEN, GIVEN) == [(0.0, True), (2.0, True)]


# --- arrays ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("index", ["x", "1"])
def test_a_constant_may_be_an_array(index: str) -> None:
    text = f"{ROBOT}let t = a + 0 module m {{ when b do out(v = t[{index}], on = b) }}\nnetwork {{ out = m }}"
    program = load_text(text)
    (let,) = program.derived
    table = e.Constant(type=Array(PLAIN, 5), value=(10.0, 20.0, 30.0, 40.0, 50.0))
    assert isinstance(let, Let)
    program = replace(program, derived=(replace(let, expression=table),))
    assert sent(program, GIVEN, {**GIVEN, "x": 4.0})[0] == (20.0, True)


def test_a_window_of_what_stands_in_for_an_array_and_of_its_past() -> None:
    text = f"""{ROBOT}
    module m {{
      when b
      do out(v = sum(window(value_or(previous(a, 0), 9), x, 1)), on = b)
    }}
    network {{ out = m }}"""
    assert sent(load_text(text), GIVEN, GIVEN) == [(0.0, True), (12.0, True)]


# --- modules in Python -------------------------------------------------------------------------------


def test_fields_of_a_module_in_python_have_the_kinds_of_their_types() -> None:
    program = load_text(PYTHON)
    code = lower(program, compile_program(program).clients)
    assert kinds(code, PythonField) == [Kind.NUMBER, Kind.BOOL]


def test_the_activity_of_a_module_elsewhere_is_a_truth_value() -> None:
    program = load_text(PYTHON)
    code = lower_client(program, compile_program(program).clients, "out", "m")
    assert kinds(code, OutsideActive) == [Kind.BOOL]
