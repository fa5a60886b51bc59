"""Frames in which an actuator was given something else than the network decided."""

from __future__ import annotations

from dataclasses import replace
from random import Random

import pytest

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.executor import ProgramExecutor
from colony.ir.frame import Decision, Frame, OverriddenCommand
from colony.ir.program import PythonModule, in_base_units, in_declared_units
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.frames import Choices
from tests.drawn.strategies import run_of_seed
from tests.sampling import sampled

TEXT = """
robot r {
  sensor go : bool default false from PServer.go
  actuator drive { velocity : m/s range -1 .. 1 } to RServer.drive idle drive(velocity = 0)
  actuator lift { height : mm range 0 .. 500 } to Lift.height idle hold
}
module cruise { when go do drive(velocity = 0.5 m/s) }
module raise { when go do lift(height = 100 mm) }
network { drive = cruise  lift = raise }
"""

MS = 1_000_000


def contracts(*texts: str) -> str:
    """Return the program with contracts `c0`, `c1`, ..."""
    return TEXT + "\n".join(f"contract c{i}: {text}" for i, text in enumerate(texts))


def both_executors(text: str) -> tuple[Interpreter, ProgramExecutor]:
    program = load_text(text)
    return Interpreter(program), ProgramExecutor(compile_program(program).compiled)


@pytest.mark.parametrize(
    ("given", "sent", "true"),
    [
        (
            OverriddenCommand((250.0,)),
            0.25,
            ("drive.velocity == 0.25 m/s", "drive is commanded", "not (drive is idle)", "cruise is active"),
        ),
        (OverriddenCommand(), 0.0, ("drive.velocity == 0", "drive is idle", "not (drive is commanded)")),
    ],
    ids=["from outside", "of a late client"],
)
def test_contracts_see_the_command_that_an_actuator_is_given(
    given: OverriddenCommand, sent: float, true: tuple[str, ...]
) -> None:
    for executor in both_executors(contracts(*true, "not (drive by cruise)")):
        outcome = executor.step(Frame(0, {"go": True}), given={"drive": given})
        assert (outcome.breaches, outcome.records) == ((), ())
        assert outcome.decisions[0] == Decision("drive", None, (sent,))


def test_idle_hold_holds_what_was_given_last() -> None:
    text = contracts("lift.height == 70 mm", "lift.height <= 500 mm")
    for executor in both_executors(text):
        first = executor.step(Frame(0, {"go": True}), given={"lift": OverriddenCommand()})
        assert first.breaches == ("c0", "c1"), "nothing was sent yet"
        assert first.decisions[1] == Decision("lift", None, None)
        second = executor.step(Frame(50 * MS, {"go": True}), given={"lift": OverriddenCommand((70.0,))})
        third = executor.step(Frame(100 * MS, {"go": True}), given={"lift": OverriddenCommand()})
        assert (second.breaches, third.breaches) == ((), ())
        assert executor.step(Frame(150 * MS, {"go": True})).breaches == ("c0",)


def test_bounds_are_those_of_the_frame_whoever_commands() -> None:
    text = TEXT + "limit drive.velocity <= 0.3 m/s when go\nlimit lift.height >= 600 mm when go"
    interpreter = Interpreter(load_text(text))
    drive, lift = interpreter.program.robot.actuators
    interpreter.step(Frame(0, {"go": False}))
    assert interpreter.bounds(drive) == ((-1000.0, 1000.0),)
    interpreter.step(Frame(50 * MS, {"go": True}), given={"drive": OverriddenCommand((0.0,))})
    assert interpreter.bounds(drive) == ((-1000.0, 300.0),)
    assert interpreter.bounds(lift) is None, "they contradict each other"


@pytest.mark.parametrize(
    ("unit", "bound"), [("rad/s", 30.0), ("rad/s", -90.0), ("rad/s", 1e-3), ("deg/s", 29.999999999999996)]
)
def test_a_command_at_a_bound_reads_back_as_the_bound(unit: str, bound: float) -> None:
    """Whatever the conversion to declared units and back rounds, what is proved of the bound holds."""
    text = f"""
    robot r {{
      sensor go : bool default false from PServer.go
      actuator spin {{ turn : {unit} }} to RServer.spin idle spin(turn = 0)
    }}
    module cruise {{ when go do spin(turn = 0 deg/s) }}
    network {{ spin = cruise }}
    """
    for relation in ("<=", ">="):
        for executor in both_executors(
            f"{text}limit spin.turn {relation} {bound!r} deg/s\n"
            f"contract held: spin.turn {relation} {bound!r} deg/s"
        ):
            actuator = load_text(text).robot.actuators[0]
            declared = in_declared_units((bound,), actuator.fields)
            assert declared is not None
            given = {"spin": OverriddenCommand(in_base_units(declared, actuator.fields))}
            outcome = executor.step(Frame(0, {}), given=given)
            assert outcome.breaches == ()
            assert outcome.decisions[0].values == declared
            beyond = 1e-9 if relation == "<=" else -1e-9
            wrong = executor.step(Frame(50 * MS, {}), given={"spin": OverriddenCommand((bound + beyond,))})
            assert wrong.breaches == ("held",)


def test_a_late_client_breaks_no_contract_in_time() -> None:
    """It is excused in the frame; if it remembers what was sent, until memory restarts."""
    texts = {
        "plain": "cruise is active implies drive by cruise",
        "other": "cruise is active implies drive by cruise and lift.height == 100 mm",
        "remembers": "previous(drive is commanded, true)",
        "holds": "lift.height >= 110 mm",
        "sensed": "previous(go, true) implies drive by cruise",
        "wrong": "drive.velocity > 0.6 m/s",
    }
    text = TEXT + "\n".join(f"contract {name} in time: {text}" for name, text in texts.items())
    frame = Frame(0, {"go": True})
    for executor in both_executors(text):
        steps = [
            executor.step(frame._replace(t_ns=k * MS), given=given).breaches
            for k, given in enumerate(
                (
                    {},
                    {"lift": OverriddenCommand()},
                    {"drive": OverriddenCommand()},
                    {},
                    {"drive": OverriddenCommand((70.0,))},
                )
            )
        ]
        assert steps == [
            ("holds", "wrong"),
            ("wrong",),
            (),
            ("wrong",),
            ("plain", "sensed", "wrong"),
        ]


@pytest.mark.parametrize("is_late", [False, True])
def test_what_a_contract_in_time_remembers_is_memory_of_the_program(is_late: bool) -> None:
    text = f"{TEXT}contract c in time: not previous(drive is idle, false)"
    program = load_text(text)
    writing = ProgramExecutor(compile_program(program).compiled, simplified=False)
    writing.step(Frame(0, {}), given={"drive": OverriddenCommand()} if is_late else {})
    memory = writing.memory
    assert memory is not None
    resumed, reading = (
        Interpreter(program),
        ProgramExecutor(compile_program(program).compiled, simplified=False),
    )
    resumed.resume(memory)
    reading.resume(memory)
    restored, state = Interpreter(program), resumed.state
    assert state is not None
    restored.restore(state)
    expected = () if is_late else ("c",)
    for executor in (writing, reading, resumed, restored):
        assert executor.step(Frame(50 * MS, {})).breaches == expected


def drawn_given(choices: Choices, interpreter: Interpreter) -> dict[str, OverriddenCommand]:
    """Draw what some actuators are given."""
    given = {}
    for actuator in interpreter.program.robot.actuators:
        if choices.one_in(3):
            given[actuator.name] = OverriddenCommand()
        elif choices.one_in(3):
            is_bool = [type(f.type).__name__ == "Bool" for f in actuator.fields]
            given[actuator.name] = OverriddenCommand(
                tuple(choices.one_in(2) if b else float(choices.up_to(9)) for b in is_bool)
            )
    return given


@pytest.mark.parametrize("seed", sampled(range(200), every=8))
def test_the_plain_executor_agrees(seed: int) -> None:
    program, trace = run_of_seed(seed)
    if any(isinstance(m, PythonModule) for m in program.modules):
        return
    in_time = (replace(c, in_time=i % 2 == 0) for i, c in enumerate(program.contracts))
    program = replace(program, contracts=tuple(in_time))
    choices = Choices(Random(seed))
    interpreter = Interpreter(program)
    compiled = compile_program(program).compiled
    executors = [ProgramExecutor(compiled), ProgramExecutor(compiled, simplified=False)]
    for frame in trace:
        given = drawn_given(choices, interpreter)
        expected = repr(interpreter.step(frame, given=given))
        assert [repr(e.step(frame, given=given)) for e in executors] == [expected, expected]
