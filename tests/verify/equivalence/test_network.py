"""The formulas of a network against the reference interpreter, frame by frame."""

from __future__ import annotations

import pytest

from colony.ir.program import Chain, Use, Wire
from colony.verify.equivalence.circuit import Activity, Circuit, HeldInput, Input
from colony.verify.equivalence.network import encode_network
from colony.verify.reference.interpreter import Interpreter
from tests.drawn.strategies import run_of_seed
from tests.networks import chain, driven
from tests.verify.equivalence.valuations import valued


@pytest.mark.parametrize("seed", range(150))
def test_formulas_are_what_the_interpreter_does(seed: int) -> None:
    program, trace = run_of_seed(seed, network=True)
    circuit = Circuit()
    source = encode_network(program, circuit)
    interpreter, last = Interpreter(program), dict[int, int]()  # when each operand of a history was last true
    for frame in trace:
        outcome = interpreter.step(frame)
        inputs: dict[Input, bool] = {}
        for of in circuit.inputs:
            if isinstance(of, Activity):
                inputs[of] = interpreter.is_active(of.module)
            elif isinstance(of, HeldInput):
                before = last.get(of.operand)
                inputs[of] = before is not None and frame.t_ns - before < of.window_ns
        value = valued(circuit, inputs)
        for decision in outcome.decisions:
            root = source.roots.get(decision.actuator)
            winners = [module for module, win in root.wins.items() if value(win)] if root else []
            assert winners == ([decision.by] if decision.by else []), seed
        for name in source.names:
            assert value(source.activity(name)) == interpreter.is_active(name), (seed, name)
        last |= {o.operand: frame.t_ns for o in inputs if isinstance(o, HeldInput) and value(o.operand)}


def test_a_long_chain_is_no_deep_recursion() -> None:
    circuit = Circuit()
    source = encode_network(chain(5_000), circuit)
    assert len(source.roots["drive"].wins) == 5_000


def test_time_constants_stand_where_they_are_written() -> None:
    operands = tuple(Use(name=f"m{i}") for i in range(3))
    wiring = Chain(relation="inhibits", operands=operands, windows_ns=(7, 9))
    circuit = Circuit()
    source = encode_network(driven(3, [Wire(name="w", wiring=wiring)], "w"), circuit)
    windows = {of.window_ns: of.operand for of in circuit.inputs if isinstance(of, HeldInput)}
    assert windows == {7: source.activity("m0"), 9: source.activity("m1")}
