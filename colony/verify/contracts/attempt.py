"""One contract in one setting: in a frame alone, with invariants, by induction, and by search."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

from colony.verify.contracts.houdini import keeps
from colony.verify.contracts.induction import Induction, Known, follows
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.results import Trace
from colony.verify.contracts.search import Search
from colony.verify.contracts.setting import Setting
from colony.verify.contracts.solver import Budget


class Proof(NamedTuple):
    """A proof by k-induction, and what it used of what was known."""

    k: int
    used: tuple[str, ...]


class Attempt:
    """The attempt to prove one contract. Mutable: the length of the search, and its findings.

    Without a `refuter` only a proof is looked for: any model that breaks the contract ends the attempt.
    """

    def __init__(
        self, setting: Setting, contract: str, budget: Budget, refuter: Refuter | None = None
    ) -> None:
        self._setting = setting
        self._claim = setting.claims[contract]
        self._cone = setting.cones[contract]
        self._budget = budget
        self._refuter = refuter
        self.lemmas = setting.lemmas(self._cone)
        self._known = [Known(f"contract {c.name}", keeps(c)) for c in self.lemmas]
        self._given_up = False
        self.if_python: Trace | None = None

    @cached_property
    def _search(self) -> Search:
        lemmas = [keeps(c) for c in self.lemmas]
        return Search(self._cone, self._claim, self._budget, lemmas)

    @property
    def searched(self) -> int:
        """Number of frames up to which a counterexample was searched."""
        return self._search.length

    def run(self) -> Proof | Trace | None:
        """Return a proof, a trace that refutes the contract whatever modules in Python answer, or None."""
        proof = self.at_once()
        if proof is not None:
            return proof
        trace = self._longer()
        if trace is not None or self._given_up:
            return trace
        self._known += [Known(c.text, c.holds) for c in self._setting.invariants(self._cone, self._budget)]
        proof = self.at_once()
        if proof is not None:
            return proof
        found = self._induce()
        while found is None and self._search.length < self._longest and not self._over:
            found = self._longer()
        return found

    def at_once(self) -> Proof | None:
        """Return a proof in a frame alone, with what is known so far."""
        used = follows(self._cone, self._claim, self._known, self._budget)
        return None if used is None else Proof(0, used)

    def _induce(self) -> Proof | Trace | None:
        """Run k-induction up to the greatest k, in turn with the search, which is its base."""
        steps = Induction(self._cone, self._claim, self._known, self._budget)
        for k in range(1, self._budget.options.depth + 1):
            used = steps.next()
            if used is not None and self._search.clear >= k:
                return Proof(k, used)
            trace = self._longer()
            if trace is not None:
                return trace
            if self._over:
                return None
        return None

    @property
    def _over(self) -> bool:
        return self._given_up or self._budget.spent()

    @property
    def _longest(self) -> int:
        """Number of frames to search; 0 where a module in Python can break the contract: little improves."""
        return self._budget.options.longest if self.if_python is None else 0

    def _longer(self) -> Trace | None:
        """Look for a counterexample one frame longer."""
        for candidate in self._search.longer(asked=self.if_python is None):
            if self._refuter is None:
                self._given_up = True
                return None
            trace = self._refuter.believe(candidate, self._search)
            if trace is not None and candidate.unasked:
                return trace
            if trace is not None:
                self.if_python = trace
                return None
            if not self._refuter.patient(candidate):
                return None
        return None
