"""Proofs and counterexamples in a single frame: any frame with any memory, or the first frame of a run.

One solver has the formulas of all claims about a system, and keeps what it learned of the system.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import z3

from colony.verify.contracts.solver import Answer, Budget, Solver
from colony.verify.symbolic.system import Claim, System


class KnownCondition(NamedTuple):
    """A condition that is true in every frame, and its description."""

    text: str
    formula: z3.BoolRef


class SingleFrames:
    """A frame of a system, in one solver. Mutable: facts are added when a claim first needs them."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._cells = {c.old.get_id(): c for c in system.cells}
        self._solver = Solver()
        self._is_first = z3.Bool("first frame of a run")
        self._added = set[int]()
        self._add([system.now, system.begun, system.last])

    def breaks_first(self, claim: Claim, budget: Budget) -> tuple[Answer, z3.ModelRef | None]:
        """Return whether the first frame of a run may break a claim, with a model if it may."""
        with self._broken(claim, budget, 1.0):
            answer = self._solver.check([self._is_first])
            return answer, self._solver.model() if answer is Answer.SAT else None

    def breaks(
        self, claim: Claim, known: Sequence[KnownCondition], budget: Budget, share: float = 1.0
    ) -> tuple[Answer, tuple[str, ...]]:
        """Return whether a frame may break a claim; if none may, with those of `known` that show it."""
        switches = [z3.Bool(f"known {i}") for i in range(len(known))]
        self._add(k.formula for k in known)
        with self._broken(claim, budget, share):
            self._solver.add(*(z3.Implies(s, k.formula) for s, k in zip(switches, known, strict=True)))
            answer = self._solver.check(switches)
            core = self._solver.core() if answer is Answer.UNSAT else frozenset()
        return answer, tuple(k.text for k, s in zip(known, switches, strict=True) if str(s) in core)

    @contextmanager
    def _broken(self, claim: Claim, budget: Budget, share: float) -> Iterator[None]:
        """Assume that a claim is broken."""
        self._add([claim.holds])
        self._solver.use(budget, share)
        self._solver.push()
        try:
            self._solver.add(z3.Not(claim.holds))
            yield
        finally:
            self._solver.pop()

    def _add(self, terms: Iterable[z3.ExprRef]) -> None:
        """Add the facts on which terms depend within a frame."""
        graph = self._system.graph
        pending = graph.add(terms)
        while pending:
            key = pending.pop()
            if key in self._added:
                continue
            self._added.add(key)
            pending.extend(graph.operands(key))
            if key in self._cells:
                cell = self._cells[key]
                self._solver.add(z3.Implies(self._is_first, cell.old == cell.initial))
            formulas = [fact.formula for fact in self._system.facts.get(key, ())]
            self._solver.add(*formulas)
            pending.extend(graph.add(formulas))
