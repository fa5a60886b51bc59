"""An attempt to prove one contract, or to refute it by a search for traces of growing length."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

from colony.text.wording import counted
from colony.verify.contracts import spacer
from colony.verify.contracts.candidates import Candidate
from colony.verify.contracts.houdini import invariants
from colony.verify.contracts.induction import Induction
from colony.verify.contracts.proof_context import ProofContext
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.results import Trace
from colony.verify.contracts.search import CandidateTrace, Search, called_modules
from colony.verify.contracts.single_frames import KnownCondition
from colony.verify.contracts.solver import Answer, Budget
from colony.verify.symbolic.unrolling import OneFrame

_SPACER_SHARE = 1 / 48
"""Share of a budget for Spacer, which mostly answers quickly or not at all, before invariants are guessed."""

_LONG_SPACER = ((True, 1 / 8), (False, 1 / 4))
"""Attempts of Spacer if nothing else proves the contract: whether it is guided, and its share of a budget."""

_CHEAP_SHARE = 1 / 2000
"""Share of a budget up to which the search of one length is cheap."""

_MAX_CHEAP_FRAMES = 300
"""Maximum length of a counterexample as long as lengths are cheap to search."""


class Proof(NamedTuple):
    """A proof by k-induction, and the known conditions that it uses."""

    k: int
    conditions_used: tuple[str, ...]


class Attempt:
    """An attempt to prove or refute one contract. Stateful: remembers what it has searched and found.

    Without a `refuter` it only tries to prove: any model that breaks the contract ends the attempt.
    `known_invariants` hold before every frame. `asks_spacer`: numbers are not too long for it.
    `asks_first_frame`: the solver of single frames was not asked about the first frame before.
    `python_trace`, if not None, breaks the contract if the Python modules answer as in the trace.
    """

    def __init__(
        self,
        context: ProofContext,
        contract: str,
        budget: Budget,
        refuter: Refuter | None = None,
        known_invariants: Sequence[Candidate] = (),
        *,
        asks_spacer: bool = True,
        asks_first_frame: bool = True,
    ) -> None:
        self._asks_spacer = asks_spacer
        self._asks_first_frame = asks_first_frame
        self._context = context
        self._claim = context.claims[contract]
        self._cone = context.cones[contract]
        self._budget = budget
        self._refuter = refuter
        self.lemmas = context.lemmas(self._cone)
        self._known_conditions = [KnownCondition(f"contract {c.name}", c.holds) for c in self.lemmas]
        self._know(known_invariants)
        self._has_given_up = False
        self._is_breakable = False  # over the numbers of formulas
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
        trace = (self._break_first_frame() if self._asks_first_frame else None) or self._search_longer()
        if trace is not None or self._has_given_up:
            return trace
        found = self._ask_spacer(_SPACER_SHARE)
        if found is None and not self._is_breakable:
            found = self._prove_with_invariants() or self._induce()
        for guided, share in _LONG_SPACER:
            if found is None and not self._is_breakable and not self._is_over:
                found = self._ask_spacer(share, guided=guided)
        while found is None and self._may_search_longer:
            found = self._search_longer()
        return found

    def prove_in_one_frame(self, share: float = 1.0) -> Proof | None:
        """Return a proof in a single frame from the conditions known so far, None if there is none.

        It may use `share` of a full query's resources.
        """
        self._budget.deadline.begin_stage("a proof in one frame")
        frames, known = self._context.single_frames, self._known_conditions
        answer, used = frames.breaks(self._claim, known, self._budget, share)
        return Proof(0, used) if answer is Answer.UNSAT else None

    def _break_first_frame(self) -> Trace | None:
        """Return a first frame that breaks the contract, if z3 has it at once."""
        if self._refuter is None or called_modules(self._cone):
            return None
        answer, model = self._context.single_frames.breaks_first(self._claim, self._budget)
        if answer is not Answer.SAT or model is None:
            return None
        frame = OneFrame(self._cone.system, self._cone)
        return self._refuter.confirm_in(frame, CandidateTrace(model, 1, without_python=True))

    def _prove_with_invariants(self) -> Proof | None:
        """Return a proof in a single frame from invariants that are guessed from templates."""
        self._budget.deadline.begin_stage("guessing invariants")
        self._know(self._context.invariants(self._cone, self._budget))
        return self.prove_in_one_frame()

    def _ask_spacer(self, share: float, *, guided: bool = False) -> Proof | Trace | None:
        """Return a proof by Spacer's invariant, or a trace of the length that it gives."""
        if not self._asks_spacer:
            return None
        self._budget.deadline.begin_stage("asking Spacer for an invariant")
        lemmas = [lemma.holds for lemma in self.lemmas]
        match spacer.solve(self._cone.system, self._claim, lemmas, self._budget, share, guided=guided):
            case spacer.Safe(guesses=guesses):
                known = [c.formula for c in self._known_conditions]
                found = invariants(self._cone, guesses, (), known, self._budget).conditions
                self._context.record_invariants(self._cone, found)
                self._know(found)
                return self.prove_in_one_frame()
            case spacer.Broken(frames=frames, safe_frames=safe_frames):
                self._is_breakable, self._has_given_up = True, self._refuter is None
                if self._has_given_up:
                    return None
                self._search.skip_to(safe_frames)
                trace = None
                while trace is None and self._search.length < frames and not self._is_over:
                    trace = self._search_longer()
                return trace
            case None:
                return None

    def _know(self, found: Sequence[Candidate]) -> None:
        """Use conditions that hold before every frame from now on."""
        self._known_conditions += [KnownCondition(c.text, c.formula) for c in found]

    def _induce(self) -> Proof | Trace | None:
        """Run k-induction up to the maximum k, alternating with the search, which is its base case."""
        induction = Induction(self._cone, self._claim, self._known_conditions, self._budget)
        for k in range(1, self._budget.options.depth + 1):
            self._budget.deadline.begin_stage(f"induction over {counted(k, 'frame')}")
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
    def _may_search_longer(self) -> bool:
        """Return True if one more frame may be searched.

        Beyond the maximum, only while frames are cheap and no model was found, which would be spurious.
        """
        if self.python_trace is not None or self._is_over:
            return False
        if self._search.length < self._budget.options.max_frames:
            return True
        if self._is_breakable or (self._refuter is not None and self._refuter.spurious_models):
            return False
        is_cheap = self._search.last_cost <= self._budget.options.resources * _CHEAP_SHARE
        return is_cheap and self._search.length < _MAX_CHEAP_FRAMES

    def _search_longer(self) -> Trace | None:
        """Search for a counterexample one frame longer; return None if none is found."""
        length = counted(self._search.length + 1, "frame")
        self._budget.deadline.begin_stage(f"searching runs of {length}")
        for candidate in self._search.search_next_length(allow_python=self.python_trace is None):
            if self._refuter is None:
                self._has_given_up = True
                return None
            spent = self._budget.deadline.spent
            trace = self._refuter.confirm(candidate, self._search)
            self._budget.charge_since(spent)
            if trace is not None and candidate.without_python:
                return trace
            if trace is not None:
                self.python_trace = trace
                return None
            if not self._refuter.may_try_more(candidate):
                return None
        return None
