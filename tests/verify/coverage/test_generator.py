"""Generated tests of drawn programs: they pass, and cover what they say."""

from __future__ import annotations

from dataclasses import replace

import pytest

from colony.dsl.load import load_text
from colony.verify.contracts.results import Trace
from colony.verify.coverage.generator import generate
from colony.verify.coverage.measure import GoalProver, measure, with_seen
from colony.verify.coverage.obligations import plan_of
from colony.verify.coverage.recorder import Recorder, seen_in
from colony.verify.coverage.search import found_near_tests
from colony.verify.testing.examples import run_examples
from colony.verify.testing.frames import snapshots_of
from tests.sampling import sampled
from tests.verify.small_robot import go, robot
from tools.drawn_programs import coverage


@pytest.mark.parametrize("seed", sampled(range(12), every=6))
def test_generated_tests_of_a_drawn_program_pass_and_cover_what_they_say(seed: int) -> None:
    counts, findings = coverage(seed)
    assert not findings
    assert counts["tests"]


LOCK = (
    robot()
    + "machine lock { start p0 "
    + " ".join(f"p{i} -> p{i + 1} when level == {n}" for i, n in enumerate((3, 14, 15, 92, 65, 35, 89)))
    + " }\n"
    + go("cruise", "lock == lock.p7")
    + 'network { drive = cruise }\ntest "t" {\n'
    + "".join(f"  at {i} s given level = {n}\n" for i, n in enumerate((3, 14, 15, 92, 65, 35)))
    + "}\n"
)


def test_runs_near_a_test_reach_what_follows_it() -> None:
    plan = plan_of(load_text(LOCK))
    (goal,) = [g for g in plan.goals.values() if g.text == "`lock` takes `p6 -> p7`"]
    ((name, run),) = found_near_tests(plan, [goal])
    assert isinstance(run, Trace)
    assert len(run.snapshots) == 7
    assert name in seen_in(plan, run.snapshots)


ASSUMING = (
    robot()
    + "assume dry: not bumper\nassume slowly: previous(sonar, sonar) - sonar <= 30 mm\n"
    + go("backs", "bumper", "-80 mm/s")
    + go("stands", "value_or(previous(sonar, sonar) - sonar > 50 mm, false)", "0")
    + go("slows", "sonar < 1 m", "100 mm/s")
    + go("cruise", "true")
    + "network { drive = backs suppresses stands suppresses slows suppresses cruise }\n"
    + "contract near: value_or(sonar < 500 mm and previous(sonar > 500 mm, false), false)"
    + " implies drive.velocity <= 100 mm/s\n"
    + "contract wet: value_or(bumper, false) implies drive.velocity <= 0\n"
)


def test_under_assumptions_no_run_breaks_them_and_what_they_exclude_is_impossible() -> None:
    plan = plan_of(load_text(ASSUMING))
    found = measure(plan, set(), 0, GoalProver(plan))
    states = {(m.obligation.subject, m.obligation.text): (m.state, m.assuming) for m in found.measured}
    assert states["backs", "active"] == ("impossible", ("dry",))
    assert states["wet", "value_or(bumper, false)"] == ("impossible", ("dry",))
    assert states["stands", "active"] == ("impossible", ("slowly",))
    assert states["slows", "wins"] == ("uncovered", ())
    assert not found.counts()["unknown"]
    generated = generate(found, set())
    assert not generated.left_out
    program = load_text("\n".join([ASSUMING, *(test.text for test in generated.tests)]))
    watched = replace(program, contracts=tuple(replace(c, assumed=False) for c in program.contracts))
    assert all(result.passed for result in run_examples(watched))  # contracts, and what is assumed
    covered = Recorder(plan)
    covered.run_tests(program.tests)
    counts = with_seen(found, covered.seen, 0).counts()
    assert (counts["covered"], counts["uncovered"]) == (found.counts()["uncovered"], 0)


def test_a_run_that_breaks_an_assumption_shows_nothing() -> None:
    plan = plan_of(load_text(ASSUMING + 'test "t" { at 0 s given bumper = true }'))
    (test,) = plan.program.tests
    assert not seen_in(plan, snapshots_of(plan.program, test))
    own = Recorder(plan)
    own.run_tests([test])  # but a test of the program counts
    assert "module backs active" in own.seen


TASKS = (
    robot()
    + go("ahead", "true")
    + go("spin", "true", "0", "10 deg/s")
    + "sequence deliver {\n"
    + "  leave = ahead() until level == 10 within 10 s else failed\n"
    + "  turn = spin() until level == 20 within 30 s else failed\n"
    + "}\n"
    + "network { drive = deliver.drive }\n"
    + "module lost { when deliver == deliver.failed do drive(velocity = 0, turn = 0) }\n"
    + 'test "t" { at 0 s given level = 0  at 1 s given level = 10  at 2 s given level = 0 }\n'
)


@pytest.mark.long
def test_readings_are_held_until_the_time_of_a_task_is_over() -> None:
    plan = plan_of(load_text(TASKS))
    goals = [g for g in plan.goals.values() if "-> failed`" in g.text]
    found = dict(found_near_tests(plan, goals))
    assert found.keys() == {g.name for g in goals}
    assert sorted(len(run.snapshots) // 100 for run in found.values()) == [2, 6]  # 50 ms a frame
    assert all(name in seen_in(plan, run.snapshots) for name, run in found.items())


UNWRITABLE = (
    robot("sensor far : mm from PServer.far")
    + go("slow", "far > 5 m", "100 mm/s")
    + go("cruise", "bumper", "300 mm/s")
    + "network { drive = slow suppresses cruise }\n"
    + "contract careful: fresh(sonar) or not (drive by cruise)\n"
)


def test_generated_tests_break_no_contract_and_give_no_infinite_reading() -> None:
    plan = plan_of(load_text(UNWRITABLE))
    found = measure(plan, set(), 0, GoalProver(plan))
    generated = generate(found, set())
    assert not generated.left_out
    program = load_text("\n".join([UNWRITABLE, *(test.text for test in generated.tests)]))
    assert all(result.passed for result in run_examples(program))


def test_a_limit_cuts_no_command_of_a_module_that_only_inhibits() -> None:
    text = (
        robot("actuator lamp { level : number, on : bool } to DServer.Lamp idle hold")
        + go("cruise", "true", turn="20 deg/s")
        + "module shine { when bumper do lamp(level = 1, on = true) }\n"
        + "network { drive = shine inhibits cruise  lamp = shine }\n"
        + "limit drive.turn <= level * 1 deg/s\n"
    )
    plan = plan_of(load_text(text))
    (goal,) = [g for g in plan.goals.values() if g.text.startswith("a command goes beyond")]
    assert isinstance(GoalProver(plan).answer(goal), Trace)
