"""Contracts of small behaviors get the verdict that they deserve."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
import z3

from colony.verify.contracts.concrete_runs import Replay
from colony.verify.contracts.prove import prove_contracts, results
from colony.verify.contracts.report import verdict
from colony.verify.contracts.results import OverReals, ProofOptions, Proved, Unknown
from colony.verify.contracts.solver import Deadline, IncrementalSolver, SolverAnswer
from colony.verify.snapshot import Snapshot
from tests.verify.contracts.behaviors import MEAN, ROBOT, program, proved, refuted, result, unknown

COUNTER = "state n = 0  next n = if bump then (if n == 4 then 0 else n + 1) else n\n"
MACHINE = """machine m {
  start rest
  rest -> go when bump
  go -> back when falling(bump)
  back -> rest when recently(stop, 1 s)
}
"""

TRUE = {
    "one frame": "contract c: back is active and not (cruise is active) implies drive by back",
    "a range": "contract c: fresh(far) implies far <= 10 m",
    "a clamped field": "contract c: drive.velocity in -1 m/s .. 1 m/s",
    "a missing sensor": "contract c: not fresh(far) implies not (cruise is active)",
    "a default": "contract c: not fresh(stop) implies not stop",
    "a counter": COUNTER + "contract c: n <= 4",
    "a counter and the cell before it": COUNTER + "contract c: previous(n, 0) <= 4",
    "phases": MACHINE + "contract c: m == m.rest or m == m.go or m == m.back",
    "memory of a machine": MACHINE
    + "contract c: elapsed(m == m.go) > 0 implies m == m.go and previous(m == m.go, false)",
    "a latch": "let l = latch(bump, stop)\ncontract c: fresh(bump) and l implies not stop",
    "a latch that was set": "let l = latch(bump, false)\n"
    "contract c: fresh(bump) implies (previous(l, false) implies l)",
    "a held window": "contract c: fresh(bump) implies recently(bump, 2 s) == (back is active)",
    "a shorter window": "contract c: fresh(bump) and recently(bump, 1 s) implies back is active",
    "a time constant": "contract c: drive by cruise implies not recently(back is active, 300 ms)",
    "time": "contract c: now >= previous(now, 0 s)",
    "a window and its timer": "contract c: fresh(bump) and elapsed(bump) > 0 s implies bump",
    "what was captured": "let k = captured(far, bump)\n"
    "contract c: fresh(far) and fresh(bump) implies k in 0 m .. 10 m",
    "a state that is clamped": "state drift = 0 deg  next drift = clamp(drift + slope, -45 deg, 45 deg)\n"
    "contract c: abs(drift) <= 45 deg",
    "two states in step": "state a = false  next a = bump\nstate b = false  next b = bump\n"
    "contract c: a == b",
    "a state of an enum": "state w : goal = goal.none  next w = want\n"
    "contract c: w == goal.none or w == goal.light or w == goal.corner",
    "arrays": "contract c: fresh(rays) implies count(rays < 2 m) <= 6 and min(rays) <= max(rays)",
    "sine is bounded": "contract c: fresh(slope) and abs(slope) <= 720 deg implies sin(slope) <= 1",
    "not a number": "contract c: not fresh(x) or x / x == 1 or x == 0 or x == 1 / 0 or x == -1 / 0",
    "a part that settles it": "contract c: (far > 11 m implies stop) or not fresh(far)",
    "a value in place of what is missing": "contract c: value_or(far, 3 m) <= 10 m",
    "a choice of what is known": "contract c: if fresh(far) then far <= 10 m else not (cruise is active)",
}
FALSE = {  # with the number of frames of the shortest trace
    "one frame": (1, "contract c: drive by back"),
    "a range": (1, "contract c: fresh(far) implies far < 10 m"),
    "a missing sensor": (1, "contract c: fresh(far)"),
    "a counter": (5, COUNTER + "contract c: n < 4"),
    "a machine": (3, MACHINE + "contract c: m != m.back"),
    "a latch": (2, "contract c: fresh(bump) and latch(bump, stop) implies bump"),
    "a held window": (2, "contract c: fresh(bump) and recently(bump, 2 s) implies bump"),
    "a longer window": (2, "contract c: fresh(bump) and recently(bump, 3 s) implies back is active"),
    "a time constant": (2, "contract c: drive is idle implies not (cruise is active)"),
    "time": (2, "contract c: now < 20 s"),
    "what was captured": (2, "contract c: fresh(far) and fresh(bump) implies captured(far, bump) == far"),
    "every": (2, "contract c: every(1 s)"),
    "the sine of what is infinite": (1, "contract c: fresh(slope) implies sin(slope) <= 1"),
    "an enum": (1, "contract c: fresh(want) implies want != goal.light"),
    "an index": (1, "contract c: fresh(rays) implies index_of_min(rays) != 3"),
    "arithmetic": (1, "contract c: fresh(x) and fresh(y) implies 3 * x + 2 * y != 12.5 or x <= y"),
    "infinite": (1, "contract c: fresh(x) implies x - x == 0"),
    "a product": (1, "contract c: fresh(x) and fresh(y) implies x * y != 12 or x < 3"),
    "what is unknown": (1, "contract c: far <= 10 m"),
    "what is unknown only later": (2, "contract c: not previous(fresh(far), false) or far <= 10 m"),
}


@pytest.mark.parametrize("text", TRUE.values(), ids=TRUE)
def test_what_always_holds_is_proved(text: str) -> None:
    proved(text)


@pytest.mark.parametrize(("frames", "text"), FALSE.values(), ids=FALSE)
def test_what_can_be_broken_is_refuted_by_a_shortest_trace(frames: int, text: str) -> None:
    found = refuted(text)
    assert len(found.trace.snapshots) == frames
    assert [bool(o.breaches) for o in found.trace.outcomes] == [False] * (frames - 1) + [True]


# --- unknown, and why ----------------------------------------------------------------------------


def test_what_holds_of_reals_only_says_so() -> None:
    found = result(MEAN + "contract c: mean < 10")
    assert isinstance(found, OverReals)
    assert "clamp(value_or(x, 0), 0, 10) - mean" in {r.span.text for r in found.in_time.over_reals}


def test_what_leaves_room_for_rounding_is_proved_for_floats() -> None:
    assert proved(MEAN + "contract c: mean <= 10.000001").over_reals == ()
    assert proved("contract c: fresh(x) and x in 1 .. 2 implies x + 0.1 >= x").over_reals == ()


@pytest.mark.parametrize(
    "contract",
    [
        "state q = 0  next q = if stop then q * 0.5 + 1 else 0\ncontract c: q < 2",
        "contract c: fresh(x) implies mod(x, 360) < 360 or x == 1 / 0 or x == -1 / 0",
        "contract c: fresh(x) and abs(x) < 1000 implies x - floor(x) < 1",
    ],
)
def test_what_tiny_numbers_or_long_runs_break_is_refuted(contract: str) -> None:
    refuted(contract)


def test_a_counter_that_stays_within_bounds_is_whole() -> None:
    text = "state n = 0  next n = if n == 100 then 0 else n + 1\n"
    assert proved(text + "contract c: n in 0 .. 100").over_reals == ()
    assert len(refuted(text + "contract c: n != 30").trace.snapshots) == 31


def test_numbers_that_are_small_under_a_condition_are_whole() -> None:
    """Once both have been true in one frame, the numbers grow in either direction, until they round."""
    text = """state valid = true  next valid = valid and not (bump and stop)
    state a = 0  next a = if not valid then a - b - b else if bump and b >= 1 then a + 1 else a
    state b = 3  next b = if not valid then b - a - a else if bump and b >= 1 then b - 1 else b
    """
    assert proved(text + "contract c: valid implies a + b == 3").over_reals == ()


@pytest.mark.parametrize(
    "unrelated",
    [
        "",
        pytest.param("state q = 0  next q = q * 0.5 + 1\ncontract d: q < 2", marks=pytest.mark.thorough),
        "let far_off = far > 7.25 m\ncontract d: x + 0.1 >= x",
        'test "t" { at 0 s given x = 4 expect not (cruise is active) }',
    ],
)
def test_a_verdict_depends_on_nothing_that_has_nothing_to_do_with_it(unrelated: str) -> None:
    contracts = ("mean < 10", "fresh(x) and abs(x) < 9 implies x - floor(x) < 1")
    found = [result(f"{unrelated}\n{MEAN}contract c: {contract}") for contract in contracts]
    assert [verdict(r) for r in found] == ["over reals", "REFUTED"]


def test_what_reals_keep_and_floats_break_is_refuted() -> None:
    found = refuted("contract c: fresh(x) and x in 1 .. 2 implies (x + 0.1) + 0.1 == x + 0.2")
    [snapshot] = found.trace.snapshots
    x = snapshot.readings["x"]
    assert isinstance(x, float)
    assert (x + 0.1) + 0.1 != x + 0.2


def test_what_holds_of_floats_says_nothing_of_reals() -> None:
    assert (
        proved("contract c: fresh(x) and fresh(bump) and x + 0.1 > 3 and bump implies bump").over_reals == ()
    )


def test_what_follows_whatever_rounding_does_takes_one_question(monkeypatch: pytest.MonkeyPatch) -> None:
    """The solver is not asked about exact sums, products and sines that a contract does not need."""
    checked, check = list[IncrementalSolver](), IncrementalSolver.check

    def counted(solver: IncrementalSolver, assumed: Sequence[z3.BoolRef] = ()) -> SolverAnswer:
        checked.append(solver)
        return check(solver, assumed)

    monkeypatch.setattr(IncrementalSolver, "check", counted)
    assert (
        proved("contract c: fresh(x) and fresh(bump) and x + 0.1 > 3 and bump implies bump").over_reals == ()
    )
    assert len(checked) == 1


def test_an_abstracted_function_leaves_it_unknown() -> None:
    found = unknown("contract c: fresh(slope) implies sin(slope) < 2 * cos(slope) or abs(slope) > 10 deg")
    assert any("`sin`" in line for line in found.because)
    assert found.trace is None
    assert "--examples" in found.hint


def test_what_the_solver_cannot_see_is_refuted_by_drawing_runs() -> None:
    found = refuted(
        "contract c: fresh(slope) implies sin(slope) < 0.9 or abs(slope) > 200 deg", ProofOptions(resources=1)
    )
    [snapshot] = found.trace.snapshots
    assert set(snapshot.readings) == {"slope"}


def test_what_no_induction_shows_is_unknown_and_tells_how_far_it_went() -> None:
    text = "state n = 0  next n = if bump then n + 0.5 else n - 0.5\ncontract c: n != 0.25"
    found = unknown(text, ProofOptions(depth=2, max_frames=5, resources=500_000))
    assert any("in the 2 frames before" in line and "up to 5 frames" in line for line in found.because)


def test_a_solver_that_may_do_nothing_gives_up_and_says_so() -> None:
    found = unknown(COUNTER + "contract c: n <= 4", ProofOptions(resources=1))
    assert "z3 reached its limits without an answer" in found.because
    assert "--timeout" in found.hint


def test_one_deadline_bounds_all_contracts_and_each_says_that_time_was_short() -> None:
    made = program(COUNTER + "contract c: n <= 4\ncontract d: far <= 11 m\n")
    deadline = Deadline(1)
    c, d = results(made, ["c", "d"], deadline=deadline)
    for found in (c, d):
        assert isinstance(found, Unknown)
        assert "the time limit was reached" in found.because
        assert "--timeout" in found.hint


def test_a_deadline_keeps_a_share_for_what_follows() -> None:
    deadline = Deadline(1200)
    deadline.begin_part(3)
    deadline.charge(500)
    assert deadline.is_over()
    deadline.begin_part(2)
    assert not deadline.is_over()
    deadline.charge(350)
    assert deadline.is_over()
    deadline.begin_part(1)
    assert deadline.left == 350


def test_runs_of_the_interpreter_are_charged_to_the_deadline() -> None:
    made, deadline = program("contract c: not bump"), Deadline()
    replay = Replay(made, "c", deadline=deadline)
    replay.breaks([Snapshot(0), Snapshot(50_000_000)])
    assert deadline.spent > 0
    assert Replay(made, "c", deadline=Deadline(deadline.spent)).affordable_frames < 3


def test_stages_are_reported_with_the_name_of_their_contract() -> None:
    stages: list[str] = []
    made = program("state n = 0  next n = if bump then n + 0.5 else n - 0.5\ncontract c: n != 0.25")
    options = ProofOptions(depth=2, max_frames=5, resources=500_000)
    list(results(made, ["c"], options, deadline=Deadline(None, stages.append)))
    assert {"c: encoding the program", "c: searching runs of 3 frames", "c: drawing runs"} <= set(stages)


# --- what proofs rest on -------------------------------------------------------------------------


def test_a_contract_that_is_proved_helps_those_after_it() -> None:
    text = "state n = 0  next n = if n > 100 then 7 else n / 2\n"
    helped = proved(text + "contract low: n <= 1\ncontract c: n <= 1 or bump")
    assert helped.k == 0


def test_a_contract_that_is_refuted_helps_none() -> None:
    made = program("contract wrong: not bump\ncontract c: not (back is active)")
    assert not any(isinstance(r, Proved) for r in prove_contracts(made))


def test_every_run_of_a_program_gives_the_same_results(tmp_path: Path) -> None:
    contracts = [
        TRUE["one frame"],
        FALSE["a time constant"][1],
        FALSE["arithmetic"][1],
        TRUE["a held window"],
    ]
    lines = [c.replace("contract c", f"contract c{i}") for i, c in enumerate(contracts)]
    path = tmp_path / "b.colony"
    path.write_text("\n".join((ROBOT, *lines)))
    command = [sys.executable, "-m", "colony.cli.main", "verify", "--format", "json", str(path)]
    runs = [
        subprocess.run(command, env={**os.environ, "PYTHONHASHSEED": seed}, capture_output=True, text=True)
        for seed in ("1", "2")
    ]
    assert '"verdict": "refuted"' in runs[0].stdout
    assert runs[0].stdout == runs[1].stdout


# --- modules in Python ---------------------------------------------------------------------------

PYTHON = """
module guess from python "nowhere:Guess" { reads far commands drive }
network { drive = stopped suppresses guess }
module stopped { when stop do drive(velocity = 0, turn = 0) }
"""
HEAD = """
robot r {
  sensor far  : m range 0 .. 10     from PServer.far
  sensor stop : bool                from RServer.stop
  actuator drive { velocity : m/s range -1 .. 1, turn : deg/s }
           to RServer.drive idle drive(velocity = 0, turn = 0)
}
"""


@pytest.fixture
def python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.verify.contracts.behaviors.ROBOT", HEAD + PYTHON)


@pytest.mark.usefixtures("python")
def test_whatever_a_python_module_answers_the_network_holds() -> None:
    proved("contract c: fresh(stop) and stop implies drive.velocity == 0 m/s")
    proved("contract c: drive.velocity <= 1 m/s")


@pytest.mark.usefixtures("python")
def test_what_a_python_module_may_break_is_unknown_with_the_answer() -> None:
    found = unknown("contract c: drive.velocity <= 0.5 m/s")
    [snapshot] = found.trace.snapshots
    assert snapshot.answers["guess"][0] > 500
    assert any("it may answer anything" in line for line in found.because)
    assert found.trace.outcomes[-1].breaches == ("c",)


@pytest.mark.usefixtures("python")
def test_what_is_broken_without_asking_python_is_refuted() -> None:
    found = refuted("contract c: drive by guess or not fresh(stop) or stop")
    assert [(s.readings, s.answers) for s in found.trace.snapshots] == [({"stop": False}, {})]


@pytest.mark.usefixtures("python")
def test_what_no_answer_of_python_can_mend_is_refuted_though_python_is_asked() -> None:
    found = refuted("contract c: value_or(far < 5 m, true)")
    assert [sorted(s.readings) for s in found.trace.snapshots] == [["far"]]


def test_what_rests_on_a_contract_that_holds_of_reals_does_too() -> None:
    found = result(MEAN + "contract a: mean < 10\ncontract c: fresh(bump) and bump implies mean < 10")
    assert isinstance(found, OverReals)
    assert found.in_time.invariants == ("contract a",)
    assert found.in_time.over_reals


def test_the_sum_of_nothing_but_a_negative_zero_is_one() -> None:
    total = "1 / sum(-0 for k in 1 .. 2 if (k == 2) == bump)"
    assert proved(f"contract c: fresh(bump) implies {total} <= 0").over_reals == ()
    refuted(f"contract c: fresh(bump) implies {total} >= 0")
