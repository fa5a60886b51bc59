"""Drawn traces for one program: what they find, how little of it is shown, and that a seed is a run."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from colony.compile.pipeline import Compilation
from colony.ir.frame import Executor, Frame, Outcome
from colony.ir.program import Program
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.agreement import ALL_EXECUTORS, Disagreement
from colony.verify.testing.differential import DifferentialReport, try_traces
from tests.programs import program

BACKS_OFF = """
module cruise { when true do out(v = 100) }
module back { when recently(a, 200 ms) and x > 7 do out(v = -1) }
module stop { when b }
network { out = stop inhibits (back suppresses cruise) }
"""


def last(of: Program, count: int = 60, seed: int = 1, **options: object) -> DifferentialReport:
    """The report after all traces."""
    *_, report = try_traces(of, count, seed, **options)  # type: ignore[arg-type]
    assert report.finished
    return report


def test_what_agrees_is_counted() -> None:
    report = last(program(BACKS_OFF))
    assert report.disagreement is None
    assert (report.drawn, report.asked, report.seed) == (60, 60, 1)
    cruise, back, stop = report.modules
    assert cruise.won
    assert back.won
    assert 0 < back.won <= back.active
    assert cruise.active == report.frames
    assert (cruise.silent, stop.won) == (0, None)
    assert back.silent > 0
    assert report.never_won == ()


def test_a_module_that_never_commands_is_named() -> None:
    report = last(program("module m { when x > 1 and x < 0 do out(v = 1) }\nnetwork { out = m }"), 20)
    assert report.never_won == ("m",)


def test_the_same_seed_gives_the_same() -> None:
    of = program(BACKS_OFF + "contract slow: out is commanded implies out.v <= 50\n")
    assert repr(last(of, 20)) == repr(last(of, 20))
    assert repr(last(of, 20)) != repr(last(of, 20, seed=2))


def test_every_report_adds_one_trace_or_shrinks_one() -> None:
    of = program(BACKS_OFF + "contract slow: out is commanded implies out.v <= 50\n")
    drawn = [report.drawn for report in try_traces(of, 5, 1)]
    assert sorted(set(drawn)) == [1, 2, 3, 4, 5]
    assert len(drawn) == 6  # one more, as the breach is shrunk


def test_none_are_asked_for() -> None:
    (report,) = try_traces(program(BACKS_OFF), 0, 1)
    assert (report.finished, report.drawn) == (True, 0)


# --- contracts -------------------------------------------------------------------------------------


def test_a_breach_is_shrunk_to_what_it_takes() -> None:
    of = program(BACKS_OFF + "contract never_back: out is commanded implies out.v >= 0\n")
    (breach,) = last(of).breaches
    assert breach.contract.name == "never_back"
    assert breach.frames > 1
    (frame,) = breach.trace
    assert frame.t_ns == 0
    assert frame.readings["a"] is True
    assert frame.readings["b"] is False
    assert frame.readings["four"] == (0.0, 0.0, 0.0, 0.0)
    assert frame.readings["y"] == 0.0


def test_a_breach_of_two_frames_keeps_its_times() -> None:
    of = program(BACKS_OFF + "contract by_a: out by back implies a\n")
    (breach,) = last(of, 100).breaches
    first, second = breach.trace
    assert (first.readings["a"], second.readings["a"]) == (True, False)
    assert 0 < second.t_ns - first.t_ns < 200_000_000


def test_contracts_that_hold_are_not_told_of() -> None:
    assert (
        last(program(BACKS_OFF + "contract bounded: out is commanded implies out.v in -1 .. 100\n")).breaches
        == ()
    )


# --- executors -------------------------------------------------------------------------------------


class Late:
    """The reference, but module `cruise` goes on for one frame after `back` has it."""

    def __init__(self, compilation: Compilation) -> None:
        self._reference = Interpreter(compilation.program)
        self._before: str | None = None

    def step(self, frame: Frame) -> Outcome:
        outcome = self._reference.step(frame)
        first, *others = outcome.decisions
        changed = self._before == "cruise" and first.by == "back"
        self._before = first.by
        if changed:
            first = first._replace(by="cruise", values=(100.0,))
        return outcome._replace(decisions=(first, *others))


def test_a_disagreement_is_shrunk_to_what_it_takes() -> None:
    report = last(program(BACKS_OFF), 200, executors={**ALL_EXECUTORS, "late": Late})
    found = report.disagreement
    assert found.executor == "late"
    assert len(found.trace) == 2
    assert [f.readings["b"] for f in found.trace] == [False, False]
    assert report.drawn < 200


def test_what_an_executor_raises_is_a_disagreement() -> None:
    class Raises:
        def step(self, frame: Frame) -> Outcome:
            raise ValueError("no")

    def make(compilation: Compilation) -> Executor:
        return Raises()

    found = last(program(BACKS_OFF), 3, executors={"raises": make}).disagreement
    assert found.found == "ValueError: no"
    assert len(found.trace) == 1


def test_an_executor_that_remembers_the_trace_before_is_told_so() -> None:
    class Tired:
        """The reference until it is started again."""

        def __init__(self, compilation: Compilation) -> None:
            self._compiled, self._begun = compilation, 0
            self.restart()

        def restart(self) -> None:
            self._begun += 1
            self._reference = Interpreter(self._compiled.program)

        def step(self, frame: Frame) -> Outcome:
            return self._reference.step(frame) if self._begun == 1 else Outcome(())

    found = last(program(BACKS_OFF), 3, executors={"tired": Tired}).disagreement
    assert found.executor == "tired, after other traces"


def test_a_trial_is_given_a_seed_of_its_own_for_each_trace() -> None:
    seeds: list[int] = []

    def trial(compilation: Compilation, trace: Sequence[Frame], seed: int) -> Disagreement | None:
        seeds.append(seed)
        if len(seeds) < 3:
            return None
        return Disagreement(executor="", trace=tuple(trace), expected=Outcome(()), found="wrong")

    found = last(program(BACKS_OFF), 9, executors={}, trials={"a trial": trial}).disagreement
    assert (found.executor, found.found) == ("a trial", "wrong")
    assert len(set(seeds[:3])) == 3
    assert set(seeds[3:]) == {seeds[2]}  # while it is shrunk


# --- modules in Python -----------------------------------------------------------------------------


def with_python(name: str) -> Program:
    return program(
        f'module m from python "tests.verify.testing.unsteady_modules:{name}" {{ reads a commands out }}\n'
        "module n { when true do out(v = 0) }\nnetwork { out = m suppresses n }\n"
    )


def test_a_module_that_does_not_do_the_same_twice_is_named() -> None:
    report = last(with_python("Shared"))
    assert report.nondeterministic.module.name == "m"
    assert report.nondeterministic.trace[-1].readings["a"] is not None
    assert report.disagreement is None
    assert report.drawn < 10


def test_modules_in_python_that_are_steady_agree_everywhere() -> None:
    report = last(with_python("Steady"), 30)
    assert report.nondeterministic is None
    assert report.disagreement is None
    assert report.never_won == ()


@pytest.mark.parametrize("seed", range(4))
def test_drawn_programs_agree(seed: int) -> None:
    from tests.drawn.strategies import run_of_seed

    of, _ = run_of_seed(seed)
    report = last(of, 15, seed)
    assert report.nondeterministic is None
    assert report.disagreement is None, str(report.disagreement)
