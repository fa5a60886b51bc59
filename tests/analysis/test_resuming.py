"""The interpreter goes on from what the compiled clients remembered, as if it had seen every frame."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.analysis.follower import Interpreters
from colony.compile.pipeline import compile_program
from colony.execute.executor import ProgramExecutor
from colony.ir.frame import Frame
from colony.ir.memory import ProgramMemory
from colony.verify.reference.interpreter import Interpreter
from tests.drawn.strategies import Run, network_runs, run_of_seed, runs
from tests.programs import program


def memories(run: Run) -> list[ProgramMemory]:
    """What the clients remember before each frame."""
    of, trace = run
    clients = ProgramExecutor(compile_program(of).compiled, simplified=False)
    found = []
    for frame in trace:
        memory = clients.memory
        assert memory is not None
        found.append(memory)
        clients.step(frame)
    return found


def check(run: Run) -> None:
    of, trace = run
    whole = Interpreter(of)
    expected = [whole.step(frame) for frame in trace]
    for k, memory in enumerate(memories(run)):
        resumed = Interpreter(of)
        resumed.resume(memory)
        for frame, outcome in zip(trace[k:], expected[k:], strict=True):
            found = resumed.step(frame)
            assert repr(found) == repr(outcome), f"resumed before frame {k}: {found}, not {outcome}"


@given(st.one_of(network_runs(max_frames=12), runs(python=False, max_frames=12)))
def test_networks_and_programs_go_on(run: Run) -> None:
    check(run)


@pytest.mark.parametrize("seed", range(40))
def test_drawn_networks_go_on(seed: int) -> None:
    check(run_of_seed(seed, network=True, max_frames=30))


EVERYTHING = """
module m {
  when rising(a)
  do out(v = x)
}
module n {
  state count = 0
  next count = count + 1
  when recently(b, 120 ms) or latch(a, c) or every(200 ms) or changed(y) or sustained(c, 90 ms)
  do out(v = previous(x, y) + captured(x, y) + elapsed(b) / 1 s + count)
}
module o { when falling(c) or changed(four[1])
  do out(v = sum(previous(four[k], 0) for k in 0 .. 3)) }
network { out = (m suppresses[150 ms] n) suppresses[100 ms] (m inhibits[70 ms] o) }
"""


def test_every_kind_of_memory_goes_on() -> None:
    of = program(EVERYTHING)
    trace = tuple(
        Frame(
            50_000_000 * k + 7,
            {
                "a": k % 7 == 2,
                "b": k % 5 < 2,
                "c": k % 11 == 4,
                "x": float(k),
                "y": float(k // 6),
                "four": [float(k // n) for n in (1, 2, 3, 4)],
            },
        )
        for k in range(60)
    )
    check((of, trace))
    kinds = {name.split()[0] for name in memories((of, trace))[30].cells}
    assert kinds >= {
        "rising",
        "recently",
        "sustained",
        "latch",
        "every",
        "previous",
        "captured",
        "changed",
        "elapsed",
        "state",
    }
    assert "window" in kinds


def test_the_memory_of_another_program_is_refused() -> None:
    memory = memories((program(EVERYTHING), (Frame(0, {}), Frame(1, {}))))[1]
    with pytest.raises(ValueError, match="which the program lacks"):
        Interpreter(program("module m { when a do out(v = 1) }\nnetwork { out = m }")).resume(memory)


@pytest.mark.parametrize(
    "changes",
    [
        {"state n.count": True},
        {"recently 3[0] until": 7.5},
        {"recently 3[0] until": math.inf},
        {"recently 3[9999] until": 0},
        {"recently 3[0] bogus": 0},
        {"rising 1[0] last": 1.0},
    ],
    ids=str,
)
def test_memory_that_does_not_fit_is_refused(changes: dict[str, float]) -> None:
    of = program(EVERYTHING)
    memory = memories((of, (Frame(0, {}), Frame(1, {}))))[1]
    assert Interpreters(of).resume(memory)
    with pytest.raises(ValueError, match="memory"):
        Interpreters(of).resume(ProgramMemory(first_ns=0, cells={**memory.cells, **changes}))
