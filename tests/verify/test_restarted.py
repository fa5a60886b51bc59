"""`restarted` is what the frame says, for every executor, in proofs, tests, traces and recordings."""

from __future__ import annotations

import io
from random import Random

import pytest

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.checked import checked_frame
from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol.messages import Tick
from colony.runtime.recordings.lines import encoder
from colony.runtime.recordings.reader import FramesReader, LinesReader
from colony.text.diagnostics import DiagnosticError
from colony.verify.contracts.example_block import example_block
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.report import frame_row
from colony.verify.contracts.results import Proved, Refuted
from colony.verify.testing.agreement import ALL_EXECUTORS, disagreement
from colony.verify.testing.examples import run_examples
from colony.verify.testing.frames import Choices, draw_trace
from tests.analysis.recorded_runs import brought
from tests.analysis.recorded_runs import logs as recorded_logs
from tests.diagnostics import problems_of
from tests.executors import outcomes

MS = 1_000_000
ROBOT = """robot r {
  frame 50 ms
  sensor bump : bool from RServer.bumper
  actuator drive { velocity : number range -1 .. 1 } to RServer.drive idle drive(velocity = 0)
}
"""
SEARCH = """
state found = false  next found = found or bump
module search { when restarted or recently(restarted, 1 s) do drive(velocity = -1) }
module go { when found do drive(velocity = 1) }
network { drive = search suppresses go }
"""


def program(text: str = SEARCH) -> Program:
    return load_text(ROBOT + text)


def frame(i: int, *, restarted: bool = False, **readings: bool) -> Frame:
    return Frame(i * 500 * MS, readings, restarted=restarted)


TRACE = (frame(0, restarted=True), frame(1, bump=True), frame(2, bump=False), frame(3, bump=False))


# --- executors ---------------------------------------------------------------------------------------


def test_all_executors_read_it_from_the_frame() -> None:
    assert disagreement(program(), TRACE, ALL_EXECUTORS) is None
    assert [o.commands["drive"].by for o in outcomes(program(), TRACE, ALL_EXECUTORS)] == [
        *("search", "search", "go", "go")
    ]
    alone = [f._replace(restarted=False) for f in TRACE]
    assert [o.commands["drive"].by for o in outcomes(program(), alone, ALL_EXECUTORS)] == [
        *(None, None, "go", "go")
    ]


def test_a_frame_is_checked() -> None:
    assert checked_frame(TRACE[0], None, program().robot.sensors).restarted is True
    with pytest.raises(TypeError, match=r"restarted: found 1; expected True or False"):
        checked_frame(Frame(0, {}, restarted=1), None, ())  # type: ignore[arg-type]


def test_it_is_drawn_in_the_first_frame_where_it_is_read() -> None:
    drawn = [draw_trace(Choices(Random(seed)), program(), 6) for seed in range(40)]
    assert {t[0].restarted for t in drawn} == {False, True}
    assert not any(f.restarted for t in drawn for f in t[1:])
    other = program("module go { when bump do drive(velocity = 1) } network { drive = go }")
    assert not any(f.restarted for seed in range(40) for f in draw_trace(Choices(Random(seed)), other, 6))


# --- names -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "declaration",
    [
        "let restarted = bump",
        "param restarted = 1",
        "state restarted = false",
        "enum restarted { a = 1 }",
        "machine restarted { start a  a -> b when bump  b -> a when bump }",
        "module restarted { when bump do drive(velocity = 1) }",
        "module other { let restarted = bump  when bump do drive(velocity = 1) }",
        "network { restarted = search }",
    ],
)
def test_nothing_else_has_its_name(declaration: str) -> None:
    assert "E109" in {d.code for d in problems_of(program, SEARCH + declaration)}


def test_no_sensor_has_its_name() -> None:
    text = ROBOT.replace("sensor bump", "sensor restarted")
    assert "E109" in {d.code for d in problems_of(load_text, text)}


# --- proofs and tests --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("contract", "holds"),
    [
        ("restarted implies not found", True),
        ("restarted implies now == 0 s", True),
        ("restarted implies not previous(true, false)", True),
        ("restarted implies not (drive is idle) or drive is idle", True),
        ("not restarted", False),
        ("now == 0 s implies restarted", False),
        ("not drive by search", False),
    ],
)
def test_proofs_let_it_be_true_where_all_memory_is_initial(contract: str, holds: bool) -> None:
    made = program(f"{SEARCH}contract c: {contract}")
    (result,) = prove_contracts(made)
    assert isinstance(result, Proved if holds else Refuted), result


def test_a_counterexample_is_a_test_and_a_frame() -> None:
    made = program(SEARCH + "contract c: not drive by search")
    (result,) = prove_contracts(made)
    assert isinstance(result, Refuted)
    assert [s.restarted for s in result.trace.snapshots] == [True]
    text = example_block(made, result.contract, result.trace)
    assert text is not None
    assert "given restarted = true" in text
    (run,) = run_examples(program(SEARCH + "contract c: not drive by search" + "\n" + text))
    assert [f.kind for f in run.failures] == ["contract broken"]
    assert frame_row(made.robot.sensors, result.trace.snapshots[0]) == {"t": 0.0, "restarted": True}


def test_tests_give_it_in_their_first_frame() -> None:
    steps = "from 0 s to 0.5 s every 0.5 s given restarted = true, bump = false expect drive by search"
    after = "at 1 s expect drive is idle"
    (run,) = run_examples(program(SEARCH + f'test "t" {{ {steps} {after} }}'))
    assert run.failures == ()


@pytest.mark.parametrize(
    "steps",
    [
        "at 0 s at 1 s given restarted = true",
        "at 0 s given restarted = missing",
        "at 0 s given restarted = 1",
    ],
)
def test_it_is_given_nowhere_else(steps: str) -> None:
    with pytest.raises(DiagnosticError):
        program(SEARCH + f'test "t" {{ {steps} }}')


# --- recordings --------------------------------------------------------------------------------------


def test_lines_keep_it() -> None:
    encode = encoder(compile_program(program()).compiled)
    text = "".join(
        encode(
            RunFrame(
                tick=Tick(k=90 * (i > 1) + i, t_ns=f.t_ns, gaps=((1, 92),) if i > 1 else ()),
                frame=f,
                verdicts={},
            )
        )
        + "\n"
        for i, f in enumerate(TRACE)
    ).encode()
    for reader in (FramesReader(io.BytesIO(text), "x"), LinesReader(io.BytesIO(text), "x")):
        assert [r.frame for r in reader.frames(program())] == list(TRACE)
    ticks = [r.tick for r in LinesReader(io.BytesIO(text), "x").frames(program())]
    assert [(t.previous, t.k) for t in ticks] == [(-1, 0), (0, 1), (1, 92), (92, 93)]


def test_mcap_keeps_it() -> None:
    found = brought("mcap", program(), recorded_logs(program(), TRACE))
    assert [r.frame for r in found] == list(TRACE)
