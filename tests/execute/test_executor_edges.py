"""Executors at their edges: foreign memory, classes that cannot be built, contracts where nothing is sent."""

from __future__ import annotations

from dataclasses import replace

import pytest

from colony.compile.lower.lower import lower
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.executor import ClientMemory, ExclusivityError, ProgramExecutor
from colony.execute.machine import build
from colony.ir.frame import Frame
from colony.text.diagnostics import DiagnosticError
from tests.programs import client, lowered
from tests.runtime.programs import roam

MS = 1_000_000
ROBOT = """
robot r {
  sensor x : number from DServer.x
  sensor b : bool from DServer.b
  actuator out { v : number } to DServer.out idle hold
}
"""
REMEMBERING = f"""{ROBOT}
state count = 0
next count = count + 1
module m {{ when recently(b, 1 s) and previous(b, false) do out(v = x + count) }}
network {{ out = m }}
"""
GO = "actuator go { velocity : mm, turn : deg } to DServer.go idle hold"
MOODY = f"""{ROBOT}
module m from python "tests.drawn.python_modules:ErraticModule" {{
  param seed = 1 reads b commands go rate 1 s
}}
module n {{ when b do out(v = 1) }}
network {{ out = n  go = m }}
""".replace("actuator out", f"{GO}\n  actuator out")


# --- memory ------------------------------------------------------------------------------------------


def test_memory_of_another_client_is_refused_and_changes_nothing() -> None:
    one = client(REMEMBERING, "out", "m")
    one.step(Frame(0, {"x": 1.0, "b": True}))
    before = one.memory
    for cells in ({}, {**before.cells, "more": 1.0}, dict.fromkeys(list(before.cells)[1:], 0.0)):
        with pytest.raises(ValueError, match=r"^the memory is of another client$"):
            one.memory = ClientMemory(0, cells)
    assert one.memory == before


def test_memory_has_the_type_of_its_cell() -> None:
    one = client(REMEMBERING, "out", "m")
    one.step(Frame(0, {"x": 1.0, "b": True}))
    good = one.memory
    kinds = {type(value) for value in good.cells.values()}
    assert kinds == {bool, int, float}
    for name, value in good.cells.items():
        for other in (True, 3, 2.5, "text", None):
            if type(other) is type(value):
                continue
            with pytest.raises(
                ValueError, match=rf"memory of .*: found {other!r}, expected a (bool|number|time)"
            ):
                one.memory = good._replace(cells={**good.cells, name: other})  # type: ignore[dict-item]
    one.memory = good
    assert one.memory == good


# --- modules in Python ---------------------------------------------------------------------------------


def test_a_class_that_cannot_be_built_is_named_with_what_to_do() -> None:
    program = load_text(MOODY)
    (call,) = lowered(program).python
    cases = (
        ({"module_path": "colony.nowhere"}, "colony.nowhere:ErraticModule", "ModuleNotFoundError"),
        ({"class_name": "Nobody"}, "tests.drawn.python_modules:Nobody", "AttributeError"),
        ({"params": (("color", 1.0),)}, "tests.drawn.python_modules:ErraticModule", "TypeError"),
        (
            {"module_path": "tests.verify.scripted_modules", "class_name": "Leaving", "params": ()},
            "tests.verify.scripted_modules:Leaving",
            "SystemExit",
        ),
    )
    for change, path, problem in cases:
        with pytest.raises(DiagnosticError) as failure:
            build(replace(call, **change))
        (found,) = failure.value.diagnostics
        assert found.code == "P001"
        assert found.span == call.span
        assert found.message.startswith(f"`{path}` cannot be imported and built: {problem}: ")
        assert found.hint == (
            "the class must be importable from the folder of the behavior or the current folder, "
            "and take its params as keyword arguments"
        )


def test_a_module_that_fails_is_recorded_by_its_name() -> None:
    (call,) = lowered(load_text(MOODY)).python
    failing = replace(call, params=(("seed", 2.0),))
    assert build(failing).step(0, {}, ())[3] == (("python error", "m"),)


# --- exclusive guards, contracts -----------------------------------------------------------------------


def test_two_exclusive_guards_at_once_are_told_by_name() -> None:
    program = roam()
    clients = compile_program(program).clients
    (drive,) = clients.actuators
    wrong = tuple(replace(c, exclusive=c.guard) for c in drive.clients)
    broken = replace(clients, actuators=(replace(drive, clients=wrong),))
    frame = Frame(0, {"sonar": (100.0,) * 24, "bumper": False, "chance": 0.5})
    executor = ProgramExecutor(lower(program, broken), exclusive=True)
    with pytest.raises(ExclusivityError, match=r"^drive: avoid, cruise$"):
        executor.step(frame)
    by_priority = ProgramExecutor(lower(program, broken))
    assert by_priority.step(frame).decisions[0].by == "avoid", "priority decides unless told otherwise"
