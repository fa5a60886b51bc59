"""Invariants by Houdini: the largest inductive subset of a set of guesses (Flanagan and Leino, 2001).

All guesses hold in the initial memory. While a frame can lead from memory in which all hold to memory in
which some do not, the latter are dropped. The rest hold before every frame. A contract that follows from the
guesses in every frame may be assumed when the guesses are checked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import assert_never

import z3

from colony.verify.contracts.candidates import Candidate
from colony.verify.contracts.cone import facts
from colony.verify.contracts.solver import Answer, Budget, Solver
from colony.verify.symbolic.cones import Cone
from colony.verify.symbolic.substitution import Substitution
from colony.verify.symbolic.system import Claim

_SHARE = 0.25
"""Share of a full query's resources for each query."""

_MAX_ROUNDS = 200


@dataclass(frozen=True, slots=True)
class Invariants:
    """Conditions that hold before every frame, and the contracts that follow from them."""

    conditions: tuple[Candidate, ...]
    claims: tuple[Claim, ...]


def invariants(
    cone: Cone,
    guesses: Sequence[Candidate],
    claims: Sequence[Claim],
    lemmas: Sequence[z3.BoolRef],
    budget: Budget,
) -> Invariants:
    """Return the guesses that are inductive together, and the `claims` that follow from them.

    `lemmas` are known to hold in every frame. If z3 gives up, fewer guesses are kept; those still hold.
    """
    subset = _GreatestSubset(cone, lemmas, budget)
    after = Substitution([c.old for c in cone.cells], [c.next for c in cone.cells])
    for guess in guesses:
        subset.add_guess(guess.formula, after(guess.formula))
    for claim in claims:
        subset.add_claim(claim.holds)
    subset.shrink()
    return Invariants(
        tuple(guesses[i] for i in sorted(subset.guesses_left)),
        tuple(claims[i] for i in sorted(subset.claims_left)),
    )


class _GreatestSubset:
    """The greatest inductive subset: drops guesses and claims until none can be broken. Mutable.

    `guesses_left`, about memory before a frame, and `claims_left`, about the frame, are indices.
    """

    def __init__(self, cone: Cone, lemmas: Sequence[z3.BoolRef], budget: Budget) -> None:
        self._budget = budget
        self._solver = Solver(budget, _SHARE)
        self._solver.add(facts(cone), *lemmas)
        self._guesses_after: list[z3.BoolRef] = []
        self._guess_switches: list[z3.BoolRef] = []
        self._claims: list[z3.BoolRef] = []
        self.guesses_left: set[int] = set()
        self.claims_left: set[int] = set()

    def add_guess(self, formula: z3.BoolRef, after: z3.BoolRef) -> None:
        i = len(self._guess_switches)
        switch = z3.Bool(f"guess {i}")
        self._solver.add(z3.Implies(switch, formula))
        self._guess_switches.append(switch)
        self._guesses_after.append(_named(self._solver, f"after {i}", after))
        self.guesses_left.add(i)

    def add_claim(self, formula: z3.BoolRef) -> None:
        i = len(self._claims)
        self._claims.append(_named(self._solver, f"claim {i}", formula))
        self.claims_left.add(i)

    def shrink(self) -> None:
        """Shrink to the greatest fixpoint, or to a smaller inductive set if z3 gives up."""
        for _ in range(_MAX_ROUNDS):
            assumed = [self._guess_switches[i] for i in sorted(self.guesses_left)]
            if self._drop(self.claims_left, self._claims, assumed):
                continue
            assumed += [self._claims[i] for i in sorted(self.claims_left)]
            if not self._drop(self.guesses_left, self._guesses_after, assumed):
                return
        self.guesses_left.clear()
        self.claims_left.clear()

    def _drop(self, kept: set[int], goals: list[z3.BoolRef], assumed: list[z3.BoolRef]) -> bool:
        """Drop from `kept` the goals that a model of `assumed` breaks; return False if none can be broken."""
        if not kept:
            return False
        self._solver.push()
        self._solver.add(z3.Or(*(z3.Not(goals[i]) for i in sorted(kept))))
        answer = self._solver.check(assumed)
        if answer is Answer.SAT:
            model = self._solver.model()
            broken = {i for i in kept if not z3.is_true(model.eval(goals[i], model_completion=True))}
        self._solver.pop()
        match answer:
            case Answer.UNSAT:
                return False
            case Answer.SAT:
                kept -= broken
                return True
            case Answer.GAVE_UP:
                return self._drop_one_by_one(kept, goals, assumed)
            case _:
                assert_never(answer)

    def _drop_one_by_one(self, kept: set[int], goals: list[z3.BoolRef], assumed: list[z3.BoolRef]) -> bool:
        """Keep the goals that can be proved one by one; return True if any was dropped.

        Used if z3 gives up on all of them together.
        """
        self._solver.use(self._budget, _SHARE / 8)
        proved = {i for i in sorted(kept) if self._solver.check([*assumed, z3.Not(goals[i])]) is Answer.UNSAT}
        self._solver.use(self._budget, _SHARE)
        dropped = kept != proved
        kept &= proved
        return dropped


def _named(solver: Solver, name: str, formula: z3.BoolRef) -> z3.BoolRef:
    """Return a constant that stands for a formula, so that a model gives its value directly."""
    constant = z3.Bool(name)
    solver.add(constant == formula)
    return constant
