"""The runtime in virtual time as an executor, and under faults: it does what the reference does, and a known
mistake in it is found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from random import Random

import pytest

from colony.analysis.virtual_executor import VirtualExecutor, with_faults
from colony.compile.pipeline import Compilation, compile_program
from colony.dsl.load import load_file, load_text
from colony.ir.frame import Frame
from colony.runtime.arbitration.arbiter import Arbiter
from colony.verify.testing.agreement import disagreement, reference
from colony.verify.testing.frames import Choices, draw_trace, frames_of
from tests.drawn.strategies import run_of_seed
from tests.found_seeds import find_seed
from tests.paths import ROOT
from tests.programs import program
from tests.runtime.assembly.test_loss import epochs_ignored, frames_invented, frames_skipped
from tests.sampling import long, thorough

RUNTIME = {"runtime": VirtualExecutor}


@cache
def compilation(name: str, robot: str | None = None) -> Compilation:
    return compile_program(load_file(ROOT / "behaviors" / f"{name}.colony", robot=robot))


def trace_of(name: str, seed: int, frames: int = 8) -> tuple[Frame, ...]:
    return draw_trace(Choices(Random(seed)), compilation(name).program, frames)


@pytest.mark.parametrize("seed", range(12))
def test_drawn_programs(seed: int) -> None:
    of, trace = run_of_seed(seed, network=seed % 2 == 0)
    found = disagreement(of, trace, RUNTIME)
    assert found is None, str(found)


def test_one_robot_goes_through_many_traces_each_from_initial_memory() -> None:
    executor = VirtualExecutor(compilation("wander"), seed=3)
    winners = Counter[str | None]()
    for seed in range(12):
        trace = trace_of("wander", seed)
        executor.restart()
        found = [executor.step(frame) for frame in trace]
        assert repr(tuple(found)) == repr(reference(compilation("wander").program, trace))
        winners.update(o.decisions[0].by for o in found)
    assert len(winners) > 3


HELD = """\
language 1
robot r { frame 20 ms
  sensor x : mm range 0 .. 1000 from S.x
  actuator lift { h : mm range 0 .. 300 } to S.lift idle hold
}
module up { when x < 500 mm do lift(h = 5 mm) }
module z { when not fresh(last.lift.h) do lift(h = 9 mm) }
network { lift = up suppresses z }
"""


def test_a_trace_does_not_see_what_was_sent_in_an_earlier_one() -> None:
    held = compile_program(load_text(HELD))
    executor = VirtualExecutor(held)
    sends = (Frame(0, {"x": 100.0}), Frame(20_000_000, {"x": 100.0}))
    given_once = (Frame(0, {"x": 750.0, "last.lift.h": 0.5}), Frame(20_000_000, {"x": 750.0}))
    for trace in (sends, given_once):
        executor.restart()
        found = [executor.step(frame) for frame in trace]
        assert repr(tuple(found)) == repr(reference(held.program, trace))


def test_traces_may_take_centuries_together() -> None:
    executor = VirtualExecutor(compilation("wander"))
    first, *_ = trace_of("wander", 1)
    century_ns = 100 * 365 * 86_400 * 10**9
    trace = (first, first._replace(t_ns=first.t_ns + century_ns // 4))
    for _ in range(26):
        executor.restart()
        assert repr(tuple(map(executor.step, trace))) == repr(reference(compilation("wander").program, trace))


def test_a_frame_that_is_not_decided_is_a_disagreement(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Arbiter, "receive", lambda *_: ())
    found = disagreement(compilation("wander").program, trace_of("wander", 1), RUNTIME)
    assert "DecisionError" in str(found.found)


# --- faults ------------------------------------------------------------------------------------------


COUNTS = """
module sum  { state n = 0  next n = n + x  when true  do base(speed = n * 1 mm/s, turn = 0) }
module also { when recently(a, 300 ms)  do out(v = value_or(previous(x, 0), -1)) }
network { base = sum  out = also }
"""
"""What it commands shows every frame that was missed, invented, or seen twice."""


def broken(of: Compilation, seeds: int) -> str | None:
    """What is said of the first run with faults that goes wrong."""
    for seed in range(seeds):
        trace = tuple(
            Frame(i, {"x": float(i + 1), "a": i % 3 == 0 if i % 7 else None}) for i in range(5 + seed % 20)
        )
        found = with_faults(of, trace, seed)
        if found is not None:
            return str(found)
    return None


def test_no_command_leaves_that_the_reference_would_not_have_sent() -> None:
    assert broken(compile_program(program(COUNTS)), 60) is None


@pytest.mark.parametrize("name", ["teleop", "figure_4_14"])
def test_neither_in_behaviors(name: str) -> None:
    for seed in range(8):
        found = with_faults(compilation(name), trace_of(name, seed), seed)
        assert found is None, f"seed {seed}: {found}"


def fault_in_examples(name: str, robot: str, seed: int) -> str | None:
    """What is said of a run with faults over the readings of an example of a behavior, bound to a robot.

    In drawn readings of a robot of many sensors some are nearly always missing, and it stands.
    """
    of = compilation(name, robot)
    assert of.program.robot.name == robot
    examples = of.program.tests
    trace = frames_of(of.program, examples[seed % len(examples)])
    found = with_faults(of, trace, seed)
    return None if found is None else f"{name} on {robot}, seed {seed}: {found}"


@pytest.mark.parametrize(
    ("name", "robot"),
    [
        ("warehouse", "amr"),
        ("shelves", "omni"),
        ("recharge", "omni"),
        ("wander", "omni"),
        ("follow_wall", "omni"),
        ("wander", "amr"),
        ("follow_wall", "amr"),
        ("wander", "rome"),
        ("follow_wall", "rome"),
    ],
)
@pytest.mark.parametrize(
    "seeds", [range(1), long(range(1, 5)), thorough(range(5, 60))], ids=["few", "more", "many"]
)
def test_neither_in_behaviors_bound_to_each_robot(name: str, robot: str, seeds: range) -> None:
    for seed in seeds:
        assert fault_in_examples(name, robot, seed) is None


@pytest.mark.long
def test_a_known_bug_is_found_in_a_behavior_on_amr(monkeypatch: pytest.MonkeyPatch) -> None:
    frames_skipped(monkeypatch)
    shown = find_seed("runtime on amr: frames_skipped", range(60), shows_a_fault)
    assert shown is not None


def shows_a_fault(seed: int) -> bool:
    said = fault_in_examples("warehouse", "amr", seed)
    assert said is None or "with faults: drive: " in said
    return said is not None


@pytest.mark.parametrize("number", [3, 223])
def test_what_nobody_can_tell_of_modules_in_python_is_not_judged(number: int) -> None:
    """Who tells others of a module in Python is down: with `degrade` it is not active for them."""
    of, trace = run_of_seed(number, max_frames=16)
    actuators = tuple(replace(a, on_loss="degrade") for a in of.robot.actuators)
    of = replace(of, robot=replace(of.robot, actuators=actuators))
    found = with_faults(compile_program(of), trace, number * 7)
    assert found is None, str(found)


@pytest.mark.parametrize("bug", [epochs_ignored, frames_skipped, frames_invented])
def test_known_bugs_are_found(
    bug: Callable[[pytest.MonkeyPatch], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    bug(monkeypatch)
    of = compile_program(program(COUNTS))
    said = broken(of, 300)
    assert said is not None
    assert said == broken(of, 300)
    assert "with faults: " in said or "a process raised" in said
