"""Spacer finds invariants and runs that nothing else finds; none of them is believed."""

from __future__ import annotations

import signal
import threading

import pytest
import z3

from colony.verify.contracts import attempt
from colony.verify.contracts.attempt import Attempt, Proof, ProofContext
from colony.verify.contracts.candidates import Candidate
from colony.verify.contracts.results import ProofOptions
from colony.verify.contracts.solver import Budget
from colony.verify.interruption import reliable_interrupts
from colony.verify.symbolic.system import SymbolicCell, System
from tests.verify.contracts.behaviors import proved, refuted
from tests.verify.contracts.systems import counter, delay, system

COUNT, OTHER, TICK = z3.Int("count"), z3.Int("other"), z3.Bool("tick")


def twice() -> SymbolicCell:
    """`other` goes up by two when `count` goes up by one."""
    return SymbolicCell(name="other", old=OTHER, next=z3.If(TICK, OTHER + 2, OTHER), initial=z3.IntVal(0))


def attempted(made: System) -> Attempt:
    return Attempt(ProofContext(made), made.claims[0].name, Budget(ProofOptions()))


def solve(made: System, budget: Budget, share: float = 1.0) -> attempt.SpacerProof | attempt.Broken | None:
    return attempt.solve(made, made.claims[0], [], budget, share)


def test_a_relation_of_two_counters_that_no_template_has_is_found() -> None:
    made = system([counter(), twice()], {"in_step": z3.Implies(OTHER == 10, COUNT == 5)})
    proof = attempted(made).run()
    assert isinstance(proof, Proof)
    assert proof.conditions_used


def test_a_contract_of_a_program_that_only_spacer_proves_is_proved() -> None:
    proved(
        "state a = 0  next a = if bump and a < 100 then a + 1 else a\n"
        "state b = 0  next b = if bump and a < 100 then b + 2 else b\n"
        "contract c: b == 10 implies a == 5\n"
    )


@pytest.mark.parametrize("limit", [0, 1, 29])
def test_the_length_of_a_run_is_that_of_the_shortest(limit: int) -> None:
    made = system([counter()], {"low": limit >= COUNT})
    assert solve(made, Budget(ProofOptions())) == attempt.Broken(limit + 2, limit + 1)


@pytest.mark.parametrize("name", ["broken", "reachable"])
def test_memory_may_have_any_name(name: str) -> None:
    made = system(delay(name, "b"), {"never": z3.Not(z3.Bool("b"))})
    assert solve(made, Budget(ProofOptions())) == attempt.Broken(3, 2)


def test_with_guidance_the_answers_are_the_same() -> None:
    made, broken = system([counter(3)], {"low": COUNT < 3}), system([counter()], {"low": COUNT <= 4})
    assert isinstance(
        attempt.solve(made, made.claims[0], [], Budget(ProofOptions()), 1.0, guided=True), attempt.SpacerProof
    )
    found = attempt.solve(broken, broken.claims[0], [], Budget(ProofOptions()), 1.0, guided=True)
    assert isinstance(found, attempt.Broken)
    assert found.safe_frames < 6 <= found.frames


def test_a_run_longer_than_the_search_goes_is_found() -> None:
    found = refuted("state n = 0  next n = if n == 100 then 0 else n + 1\ncontract c: n != 30\n")
    assert len(found.trace.snapshots) == 31


def test_a_wrong_invariant_proves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    made = system([counter()], {"low": COUNT < 7})
    guesses = (Candidate("not inductive", COUNT < 7), Candidate("wrong at first", COUNT > 0))
    monkeypatch.setattr(attempt, "solve", lambda *_, **__: attempt.SpacerProof(guesses))
    assert attempted(made).run() is None


def test_a_run_that_does_not_exist_refutes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(attempt, "solve", lambda *_, **__: attempt.Broken(3, 1))
    made = system([counter(3)], {"low": COUNT < 3})
    assert attempted(made).run() is None


def test_a_query_ends_at_its_limit() -> None:
    endless = system([counter()], {"low": COUNT < 10**9})
    budget = Budget(ProofOptions(resources=1_000_000))
    assert solve(endless, budget, 0.25) is None
    assert 740_000 <= budget.left <= 750_000


def test_a_query_costs_the_same_whatever_was_asked_before() -> None:
    made = system([counter(), twice()], {"in_step": z3.Implies(OTHER == 10, COUNT == 5)})
    budgets = [Budget(ProofOptions()), Budget(ProofOptions())]
    assert all(isinstance(solve(made, budget), attempt.SpacerProof) for budget in budgets)
    first, second = (ProofOptions().resources - budget.left for budget in budgets)
    assert second == pytest.approx(first, rel=0.2)  # z3 may order the parts of a clause in another way


def test_ctrl_c_ends_a_query(monkeypatch: pytest.MonkeyPatch) -> None:
    endless = system([counter()], {"low": COUNT < 10**9})
    query = z3.Fixedpoint.query

    def interrupted(clauses: z3.Fixedpoint, *goal: z3.ExprRef) -> z3.CheckSatResult:
        threading.Timer(0.1, signal.raise_signal, [signal.SIGINT]).start()
        return query(clauses, *goal)

    monkeypatch.setattr(z3.Fixedpoint, "query", interrupted)
    with pytest.raises(KeyboardInterrupt), reliable_interrupts():
        solve(endless, Budget(ProofOptions(resources=2**32)))


@pytest.mark.parametrize(
    ("formula", "text"),
    [
        (z3.Or(z3.Not(TICK), COUNT >= 2), "not tick or (count >= 2)"),
        (z3.Not(COUNT >= 101), "count < 101"),
        (z3.ToReal(COUNT) + z3.Q(1, 2) <= 3, "(count + 0.5) <= 3"),
        (z3.Not(z3.And(TICK, COUNT == OTHER)), "not (tick and (count == other))"),
        (z3.If(TICK, COUNT, OTHER) > 0, "(if tick then count else other) > 0"),
    ],
)
def test_an_invariant_reads_like_the_language(formula: z3.BoolRef, text: str) -> None:
    assert attempt.formula_text(formula) == text


def test_the_text_of_a_long_invariant_is_cut() -> None:
    assert len(attempt.formula_text(z3.Or(*(n < COUNT for n in range(1000))))) == 160
