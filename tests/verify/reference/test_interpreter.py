"""The interpreter alone: readings in base units, and programs of any size; the rest is in tests/semantics."""

from __future__ import annotations

from dataclasses import replace

import pytest

from colony.dsl.load import load_text
from colony.ir.expression import Constant
from colony.ir.frame import Frame, FrameEvent
from colony.ir.program import Chain, Module, Program, Use, Wire
from colony.ir.types import BOOL
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.agreement import reference
from tests.programs import program

LENGTH = 10_000


def test_base_units_are_taken_as_they_are() -> None:
    of = load_text(
        """
        robot r {
          sensor far : m range -1 .. 5 from DServer.far
          sensor three[3] : cm range 0 .. 100 default 7 from DServer.three
        }
        let it = far
        """
    )
    interpreter = Interpreter(of)
    outcome = interpreter.step_in_base_units(0, {"far": 2.0, "three": [0.1, 1000, 1001]})
    assert interpreter._moment.sensors["far"] == 2.0
    assert interpreter._moment.sensors["three"] == (0.1, 1000.0, 1000.0)
    assert outcome.records == (FrameEvent("sensor clamped", "three"),)


def chain() -> tuple[Wire, ...]:
    uses = (*(Use(name="ma") for _ in range(LENGTH)), Use(name="mb"))
    return (Wire(name="out", wiring=Chain(relation="suppresses", operands=uses, windows_ns=(0,) * LENGTH)),)


def row() -> tuple[Wire, ...]:
    links = (
        Chain(relation="suppresses", operands=(Use(name="ma"), Use(name=f"w{i}")), windows_ns=(0,))
        for i in range(LENGTH)
    )
    wires = (Wire(name=f"w{i}", wiring=link) for i, link in enumerate(links, 1))
    return (Wire(name="w0", wiring=Use(name="mb")), *wires, Wire(name="out", wiring=Use(name=f"w{LENGTH}")))


@pytest.mark.parametrize("wires", [chain(), row()], ids=["operands of a chain", "wires in a row"])
def test_ten_thousand(wires: tuple[Wire, ...]) -> None:
    of = program(
        "module ma { when a do out(v = 1) } module mb { when b do out(v = 2) }\nnetwork { out = mb }"
    )
    long = replace(of, wires=(*wires[:-1], replace(wires[-1], actuator="out")))
    trace = [Frame(0, {"a": False, "b": True}), Frame(50, {"a": True, "b": True})]
    assert [o.commands["out"].by for o in reference(long, trace)] == ["mb", "ma"]


def test_a_hand_built_program_needs_no_text() -> None:
    always = Module(name="m", when=Constant(type=BOOL, value=True))
    of = replace(program(""), modules=(always,))
    assert isinstance(of, Program)
    assert Interpreter(of).step(Frame(0, {})).breaches == ()
