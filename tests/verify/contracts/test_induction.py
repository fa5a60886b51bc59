"""The induction step holds when it should, and tells what it took."""

from __future__ import annotations

import z3

from colony.verify.contracts.results import ProofOptions
from colony.verify.contracts.search import ContractInduction, KnownCondition, SingleFrames
from colony.verify.contracts.slicing import cone_of
from colony.verify.contracts.solver import Budget, SolverAnswer
from colony.verify.symbolic.system import System
from tests.verify.contracts.systems import counter, delay, system


def first_k(
    made: System, known: tuple[KnownCondition, ...] = (), most: int = 4
) -> tuple[int, tuple[str, ...]] | None:
    """The least k for which the step of the only contract holds, and what it used."""
    [claim] = made.claims
    cone, budget = cone_of(made, claim), Budget(ProofOptions())
    answer, used = SingleFrames(made).breaks(claim, known, budget)
    if answer is SolverAnswer.UNSAT:
        return 0, used
    induction = ContractInduction(cone, claim, known, budget)
    for k in range(1, most + 1):
        used = induction.prove_next_k()
        if used is not None:
            return k, used
    return None


A, B, C, COUNT = z3.Bool("a"), z3.Bool("b"), z3.Bool("c"), z3.Int("count")


def test_what_no_memory_can_break_needs_no_frame_before() -> None:
    assert first_k(system(delay("a"), {"either": z3.Or(A, z3.Not(A))})) == (0, ())


def test_a_counter_stays_below_its_limit_by_one_frame_before() -> None:
    assert first_k(system([counter(3)], {"low": z3.And(COUNT >= 0, COUNT < 3)})) == (1, ())


def test_what_is_handed_on_twice_needs_two_frames_before() -> None:
    cells = delay("a", "b", "c")
    never = system([cells[0].__class__(name="a", old=A, next=A, initial=z3.BoolVal(False)), *cells[1:]],
                   {"never": z3.Not(C)})  # fmt: skip
    assert first_k(never) == (3, ())


def test_a_contract_that_is_not_inductive_is_never_shown() -> None:
    assert first_k(system([counter(3)], {"not_seven": COUNT != 7})) is None


def test_only_what_is_needed_is_used() -> None:
    known = (KnownCondition("count < 3", COUNT < 3), KnownCondition("count >= -100", COUNT >= -100))
    assert first_k(system([counter(3)], {"not_seven": COUNT != 7}), known) == (0, ("count < 3",))
