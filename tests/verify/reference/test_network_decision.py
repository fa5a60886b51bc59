"""What actuators are given does not change what the network decides, and that can be asked for."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from colony.compile.pipeline import compile_program
from colony.execute.executor import ProgramExecutor
from colony.ir.frame import OverriddenCommand
from colony.verify.reference.interpreter import Interpreter
from tests.drawn.strategies import Run, network_runs


@given(network_runs(), st.data())
def test_the_network_decides_the_same_whatever_is_given(run: Run, data: st.DataObject) -> None:
    program, frames = run
    actuators = program.robot.actuators
    undisturbed, disturbed = Interpreter(program), Interpreter(program)
    executor = ProgramExecutor(compile_program(program).compiled)
    for frame in frames:
        others = {
            a.name: OverriddenCommand(None if a.idle is None or data.draw(st.booleans()) else a.idle)
            for a in actuators
            if data.draw(st.booleans())
        }
        right = undisturbed.step(frame).decisions
        decisions = disturbed.step(frame, given=others).decisions
        assert tuple(map(disturbed.network_decision, actuators)) == right
        assert executor.step(frame, given=others).decisions == decisions
        assert executor.network_decisions() == right
