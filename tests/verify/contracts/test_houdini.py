"""What is kept of guesses is invariant, and it is as much as can be kept."""

from __future__ import annotations

import z3

from colony.verify.contracts.candidates import Candidate, Invariants, candidates, invariants
from colony.verify.contracts.results import ProofOptions
from colony.verify.contracts.slicing import cone_of
from colony.verify.contracts.solver import Budget
from colony.verify.symbolic.system import System
from tests.verify.contracts.systems import LAST, counter, delay, system

A, B, COUNT = z3.Bool("a"), z3.Bool("b"), z3.Int("count")


def kept(made: System, *guesses: Candidate, options: ProofOptions | None = None) -> Invariants:
    claim = made.claims[0]
    return invariants(cone_of(made, claim), guesses, made.claims, [], Budget(options or ProofOptions()))


def test_guesses_that_hold_only_together_are_kept() -> None:
    made = system([counter(3)], {"low": COUNT < 3})
    low, high = Candidate("low", COUNT >= 0), Candidate("high", COUNT < 3)
    assert kept(made, low, high).conditions == (low, high)


def test_a_guess_falls_with_the_one_that_it_rests_on() -> None:
    made = system(delay("a", "b"), {"b": z3.Not(B)})
    assert kept(made, Candidate("b", z3.Not(B)), Candidate("a", z3.Not(A))).conditions == ()


def test_contracts_that_follow_are_told() -> None:
    made = system([counter(3)], {"low": COUNT < 3, "lower": COUNT < 2})
    found = kept(made, Candidate("high", COUNT < 3), Candidate("low", COUNT >= 0))
    assert [c.name for c in found.claims] == ["low"]


def test_nothing_is_kept_that_could_not_be_shown() -> None:
    made = system([counter(3)], {"low": COUNT < 3})
    tiny = ProofOptions(resources=1)
    assert kept(made, Candidate("high", COUNT < 3), options=tiny) == Invariants((), ())


def test_templates_find_the_bounds_of_a_counter() -> None:
    made = system([counter(3)], {"low": COUNT < 3})
    cone = cone_of(made, made.claims[0])
    guesses = candidates(cone, made.claims)
    found = kept(made, *guesses)
    solver = z3.Solver()
    solver.add(*(c.formula for c in found.conditions), z3.Not(z3.And(COUNT >= 0, COUNT < 3)))
    assert solver.check() == z3.unsat
    assert [c.name for c in found.claims] == ["low"]


def test_a_remembered_time_is_not_later_than_the_last_frame() -> None:
    from colony.verify.symbolic.system import SymbolicCell
    from tests.verify.contracts.systems import NOW

    since = z3.Int("since")
    stamp = SymbolicCell(
        name="since", old=since, next=z3.If(z3.Bool("tick"), NOW, since), initial=z3.IntVal(0)
    )
    made = system([stamp], {"past": since <= LAST})
    found = kept(made, *candidates(cone_of(made, made.claims[0]), made.claims))
    assert "since <= time of the last frame" in [c.text for c in found.conditions]
