"""An attempt to prove one contract, or to refute it by a search for traces of growing length."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

from colony.verify.contracts.candidates import Candidate
from colony.verify.contracts.induction import Induction, KnownCondition, conditions_implying
from colony.verify.contracts.proof_context import ProofContext
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.results import Trace
from colony.verify.contracts.search import Search
from colony.verify.contracts.solver import Budget


class Proof(NamedTuple):
    """A proof by k-induction, and the known conditions that it uses."""

    k: int
    conditions_used: tuple[str, ...]


class Attempt:
    """An attempt to prove or refute one contract. Stateful: remembers what it has searched and found.

    Without a `refuter` it only tries to prove: any model that breaks the contract ends the attempt.
    `invariants` are known to hold before every frame.
    `python_trace`, if not None, breaks the contract if the Python modules answer as in the trace.
    """

    def __init__(
        self,
        context: ProofContext,
        contract: str,
        budget: Budget,
        refuter: Refuter | None = None,
        invariants: Sequence[Candidate] = (),
    ) -> None:
        self._context = context
        self._claim = context.claims[contract]
        self._cone = context.cones[contract]
        self._budget = budget
        self._refuter = refuter
        self.lemmas = context.lemmas(self._cone)
        self._known_conditions = [KnownCondition(f"contract {c.name}", c.holds) for c in self.lemmas]
        self._known_conditions += [KnownCondition(c.text, c.formula) for c in invariants]
        self._has_given_up = False
        self.python_trace: Trace | None = None

    @cached_property
    def _search(self) -> Search:
        lemmas = [c.holds for c in self.lemmas]
        return Search(self._cone, self._claim, self._budget, lemmas)

    @property
    def frames_searched(self) -> int:
        """Number of frames searched for a counterexample."""
        return self._search.length if "_search" in self.__dict__ else 0

    def run(self) -> Proof | Trace | None:
        """Return a proof, a trace that refutes the contract whatever Python modules answer, or None."""
        proof = self.prove_in_one_frame()
        if proof is not None:
            return proof
        trace = self._search_longer()
        if trace is not None or self._has_given_up:
            return trace
        self._known_conditions += [
            KnownCondition(c.text, c.formula) for c in self._context.invariants(self._cone, self._budget)
        ]
        proof = self.prove_in_one_frame()
        if proof is not None:
            return proof
        found = self._induce()
        while found is None and self._search.length < self._max_frames and not self._is_over:
            found = self._search_longer()
        return found

    def prove_in_one_frame(self, share: float = 1.0) -> Proof | None:
        """Return a proof in a single frame from the conditions known so far, None if there is none.

        It may use `share` of a full query's resources.
        """
        used = conditions_implying(self._cone, self._claim, self._known_conditions, self._budget, share)
        return None if used is None else Proof(0, used)

    def _induce(self) -> Proof | Trace | None:
        """Run k-induction up to the maximum k, alternating with the search, which is its base case."""
        induction = Induction(self._cone, self._claim, self._known_conditions, self._budget)
        for k in range(1, self._budget.options.depth + 1):
            used = induction.prove_next_k()
            if used is not None and self._search.safe_length >= k:
                return Proof(k, used)
            trace = self._search_longer()
            if trace is not None:
                return trace
            if self._is_over:
                return None
        return None

    @property
    def _is_over(self) -> bool:
        return self._has_given_up or self._budget.is_spent()

    @property
    def _max_frames(self) -> int:
        """Maximum number of frames to search; 0 once a Python module is known to break the contract."""
        return self._budget.options.max_frames if self.python_trace is None else 0

    def _search_longer(self) -> Trace | None:
        """Search for a counterexample one frame longer; return None if none is found."""
        for candidate in self._search.search_next_length(allow_python=self.python_trace is None):
            if self._refuter is None:
                self._has_given_up = True
                return None
            trace = self._refuter.confirm(candidate, self._search)
            if trace is not None and candidate.without_python:
                return trace
            if trace is not None:
                self.python_trace = trace
                return None
            if not self._refuter.may_try_more(candidate):
                return None
        return None
