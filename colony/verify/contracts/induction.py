"""k-induction (Sheeran, Singh and Stalmarck, 2000): what holds in k consecutive frames holds in the next.

The memory before the first of these frames is arbitrary, within the invariants.
"""

from __future__ import annotations

from collections.abc import Sequence

import z3

from colony.verify.contracts.cone import facts
from colony.verify.contracts.single_frames import KnownCondition
from colony.verify.contracts.solver import Answer, Budget, Solver
from colony.verify.symbolic.cones import Cone
from colony.verify.symbolic.system import Claim
from colony.verify.symbolic.unrolling import Unrolling


class Induction:
    """The inductive step for a contract, for k = 1, 2, ... Stateful: each k adds a frame.

    `known` are conditions that hold in every frame: invariants, and contracts proved earlier.
    """

    def __init__(self, cone: Cone, claim: Claim, known: Sequence[KnownCondition], budget: Budget) -> None:
        self._frames = Unrolling(cone.system, cone)
        self._facts = facts(cone)
        self._claim = claim
        self._known = known
        self._switches = _switches(known)
        self._solver = Solver(budget)
        self._last = 0
        self._extend()

    def prove_next_k(self) -> tuple[str, ...] | None:
        """Return the conditions of `known` that prove the step for the next k, None if it is not proved."""
        self._solver.add(self._frames.at(self._last, self._claim.holds))
        self._solver.add(*self._frames.transition(self._last))
        self._last += 1
        self._extend()
        goal = z3.Bool(f"broken {self._last}")
        broken = z3.Not(self._frames.at(self._last, self._claim.holds))
        self._solver.add(z3.Implies(goal, broken))
        if self._solver.check([goal, *self._switches]) is not Answer.UNSAT:
            return None
        return _used(self._solver, self._known, self._switches)

    def _extend(self) -> None:
        """Assume the facts and known conditions of the last frame."""
        self._solver.add(self._frames.at(self._last, self._facts))
        for switch, condition in zip(self._switches, self._known, strict=True):
            self._solver.add(z3.Implies(switch, self._frames.at(self._last, condition.formula)))


def _switches(known: Sequence[KnownCondition]) -> list[z3.BoolRef]:
    """Return a constant for each known condition; assuming the constant assumes the condition."""
    return [z3.Bool(f"known {i}") for i in range(len(known))]


def _used(solver: Solver, known: Sequence[KnownCondition], switches: Sequence[z3.BoolRef]) -> tuple[str, ...]:
    core = solver.core()
    return tuple(k.text for k, s in zip(known, switches, strict=True) if str(s) in core)
