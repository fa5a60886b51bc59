"""An attempt to prove one contract, or to refute it by a search for traces of growing length."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import z3

from colony.text.wording import counted
from colony.verify.contracts.candidates import Candidate, candidates, initially_true, invariants, not_refuted
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.results import Trace
from colony.verify.contracts.search import (
    CandidateTrace,
    ContractInduction,
    KnownCondition,
    Search,
    SingleFrames,
    called_modules,
)
from colony.verify.contracts.slicing import cone_of, covers
from colony.verify.contracts.solver import Budget, SolverAnswer
from colony.verify.interruption import interruptible
from colony.verify.symbolic import unrolling
from colony.verify.symbolic.system import ContractFormula, System
from colony.verify.symbolic.unrolling import Cone, OneFrame

# --- spacer --------------------------------------------------------------------------------------------
#
# Property-directed reachability (Bradley, 2011; Komuravelli, Gurfinkel and Chaki, 2014) by z3's Spacer.
#
# A cone as Horn clauses: the initial memory is reachable, memory is reachable if a frame leads there from
# reachable memory, and no frame from reachable memory may break the contract. Spacer answers with an
# invariant that excludes such a frame, or with the number of frames of a run that ends in one. Neither is
# believed: the parts of the invariant are guesses for `candidates.py`, and the run is searched for at that
# length.


_OPTIONS = {
    "engine": "spacer",
    "xform.slice": False,  # these three would remove the relation with the invariant
    "xform.inline_eager": False,
    "xform.inline_linear": False,
}

_MAX_LENGTH = 160
"""Maximum length of the text of a guess; a longer one is cut."""

_INFIX = {
    z3.Z3_OP_OR: "or",
    z3.Z3_OP_AND: "and",
    z3.Z3_OP_IMPLIES: "implies",
    z3.Z3_OP_EQ: "==",
    z3.Z3_OP_DISTINCT: "!=",
    z3.Z3_OP_LE: "<=",
    z3.Z3_OP_LT: "<",
    z3.Z3_OP_GE: ">=",
    z3.Z3_OP_GT: ">",
    z3.Z3_OP_ADD: "+",
    z3.Z3_OP_SUB: "-",
    z3.Z3_OP_MUL: "*",
}

_NEGATED = {
    z3.Z3_OP_EQ: "!=",
    z3.Z3_OP_LE: ">",
    z3.Z3_OP_LT: ">=",
    z3.Z3_OP_GE: "<",
    z3.Z3_OP_GT: "<=",
}


class Broken(NamedTuple):
    """A run of `frames` frames breaks the contract in its last frame; none of up to `safe_frames` does."""

    frames: int
    safe_frames: int


class SpacerProof(NamedTuple):
    """No run breaks the contract, as all of `guesses` are true of memory before every frame."""

    guesses: tuple[Candidate, ...]


def solve(
    system: System,
    claim: ContractFormula,
    lemmas: Sequence[z3.BoolRef],
    budget: Budget,
    share: float,
    *,
    guided: bool = False,
) -> SpacerProof | Broken | None:
    """Return Spacer's answer about a contract, None if it gave up.

    It may use `share` of the initial resources of a budget. `lemmas` hold in every frame. With `guided`, it
    generalizes over many clauses of its invariant at once (Vediramana Krishnan et al., 2020), which is slower
    but ends more often.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed while z3 was at work.
    """
    if budget.is_spent():
        return None
    cone = unrolling.cone(system, [claim.holds, *lemmas])
    clauses = _Clauses(cone, claim.holds, lemmas, guided=guided)
    answer = clauses.query(budget.part(share))
    budget.charge(clauses.resources_used())
    if answer == z3.sat:
        return clauses.broken()
    if answer == z3.unsat:
        guesses = [Candidate(formula_text(g), g) for g in clauses.invariant()]
        return SpacerProof(initially_true(cone, guesses))
    return None


class _Clauses:
    """The Horn clauses of a cone, in a context of their own.

    So the cost of an answer hardly depends on what z3 has done before.
    """

    def __init__(self, cone: Cone, holds: z3.BoolRef, lemmas: Sequence[z3.BoolRef], *, guided: bool) -> None:
        self._cells = [cell.old for cell in cone.cells]
        self._context = z3.Context()
        memory = self._own(self._cells)
        facts = self._own([*cone.assumptions, *cone.definitions, *cone.invariants, *lemmas])
        boolean = z3.BoolSort(self._context)  # no constant of a program has one of the two names below
        self._reachable = z3.Function("memory is reachable", *(x.sort() for x in memory), boolean)
        self._broken = z3.Function("contract is broken", boolean)
        self._z3 = z3.Fixedpoint(ctx=self._context)
        self._z3.set(**_OPTIONS, **{"spacer.global": guided})
        self._z3.register_relation(self._reachable, self._broken)
        self._z3.declare_var(*memory, *self._own(cone.constants))
        frame = [self._reachable(*memory), *facts]
        self._z3.rule(self._reachable(*self._own([c.initial for c in cone.cells])))
        self._z3.rule(self._reachable(*self._own([c.next for c in cone.cells])), frame)
        self._z3.rule(self._broken(), [*frame, z3.Not(*self._own([holds]))])

    def _own(self, terms: Sequence[z3.ExprRef]) -> list[z3.ExprRef]:
        return [term.translate(self._context) for term in terms]

    def query(self, limit: int) -> z3.CheckSatResult:
        """Return whether a run breaks the contract, `unknown` if that takes more than a limit."""
        self._z3.set(rlimit=limit)
        with interruptible(self._context):
            try:
                answer = self._z3.query(self._broken())
            except z3.Z3Exception:  # a limit, or an operation that Spacer does not know
                return z3.unknown
        if answer == z3.unknown and self.resources_used() < limit and "cancel" in self._z3.reason_unknown():
            raise KeyboardInterrupt  # which z3's own handler reports in the same words as a limit
        return answer

    def resources_used(self) -> int:
        """Return the resources used by the query, in z3's units."""
        return self._statistic("rlimit count")

    def broken(self) -> Broken:
        """Return the length of the run that breaks the contract; the initial memory counts in Spacer's."""
        length, shortest = self._statistic("SPACER cex depth"), self._statistic("SPACER max depth")
        return Broken(length - 1, min(length, shortest) - 2)

    def invariant(self) -> list[z3.BoolRef]:
        """Return the conjuncts of the invariant, over the cells."""
        found = self._z3.get_cover_delta(-1, self._reachable).translate(z3.main_ctx())
        invariant = z3.simplify(z3.substitute_vars(found, *self._cells))
        return invariant.children() if z3.is_and(invariant) else [invariant]

    def _statistic(self, name: str) -> int:
        """Return a number of z3's statistics, 0 if it does not have it."""
        return int(dict(list(self._z3.statistics())).get(name, 0))


# --- text ----------------------------------------------------------------------------------------


def formula_text(formula: z3.ExprRef) -> str:
    """Return a formula as text, cut to a length that can be read."""
    text = _text(formula, _MAX_LENGTH)
    return text if len(text) <= _MAX_LENGTH else f"{text[: _MAX_LENGTH - 3]}..."


def _text(term: z3.ExprRef, room: int) -> str:
    """Return a term as text, or the beginning of one that is longer than `room`."""
    kind, operands = term.decl().kind() if z3.is_app(term) else None, term.children()
    if room <= 0:
        return "..."
    if z3.is_rational_value(term):
        return f"{float(term.as_fraction()):.15g}"
    if kind == z3.Z3_OP_NOT and operands[0].decl().kind() in _NEGATED:
        return _joined(_NEGATED[operands[0].decl().kind()], operands[0].children(), room)
    if kind == z3.Z3_OP_NOT:
        return f"not {_operand(operands[0], room)}"
    if kind in (z3.Z3_OP_TO_REAL, z3.Z3_OP_TO_INT):
        return _text(operands[0], room)
    if kind in _INFIX:
        return _joined(_INFIX[kind], operands, room)
    if kind == z3.Z3_OP_ITE:
        parts = zip(("if", "then", "else"), operands, strict=True)
        return " ".join(f"{word} {_operand(part, room)}" for word, part in parts)
    return str(term)


def _joined(symbol: str, operands: list[z3.ExprRef], room: int) -> str:
    parts: list[str] = []
    for operand in operands:
        parts.append(_operand(operand, room - sum(map(len, parts))))
    return f" {symbol} ".join(parts)


def _operand(term: z3.ExprRef, room: int) -> str:
    """Return an operand, in parentheses if it has operands of its own."""
    text = _text(term, room)
    return f"({text})" if " " in text and not text.startswith("not ") and term.num_args() > 1 else text


# --- proof context ------------------------------------------------------------------------------------
#
# The context of proofs: one encoding of a program, and the contracts proved in it so far.

_SHARE = 0.3
"""Additional share of a contract's budget for the search for invariants."""

_MAX_GUESSES = 300
"""Maximum number of guesses to try; the likelier ones come first."""


class _Cones(dict[str, Cone]):
    """The cones of the claims of a system, by name. Mutable: computed when first asked for."""

    def __init__(self, system: System, claims: Mapping[str, ContractFormula]) -> None:
        super().__init__()
        self._system = system
        self._claims = claims

    def __missing__(self, name: str) -> Cone:
        cone = self[name] = cone_of(self._system, self._claims[name])
        return cone


class ProofContext:
    """One encoding of a program as formulas. Stateful: remembers proved contracts and found invariants."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.claims = {claim.name: claim for claim in system.claims}
        self.cones = _Cones(system, self.claims)
        self._proved: list[ContractFormula] = []
        self._elsewhere: set[str] = set()
        self._invariants: dict[frozenset[int], tuple[Candidate, ...]] = {}
        self._searched: set[frozenset[int]] = set()

    @cached_property
    def single_frames(self) -> SingleFrames:
        """The solver of single frames."""
        return SingleFrames(self.system)

    def add(self, claim: ContractFormula) -> None:
        """Add a claim about the system."""
        self.claims[claim.name] = claim

    def record_proof(self, contract: str) -> None:
        """Record that a contract holds in every frame."""
        self._elsewhere.discard(contract)
        if not self.has_proved(contract):
            self._proved.append(self.claims[contract])

    def record_lemma(self, contract: str) -> None:
        """Record that a contract holds in every frame, by a proof in another encoding."""
        if contract in self.claims and not self.has_proved(contract) and contract not in self._elsewhere:
            self._elsewhere.add(contract)
            self._proved.append(self.claims[contract])

    def has_proved(self, contract: str) -> bool:
        """Return True if a contract is proved in this encoding to hold in every frame."""
        return contract not in self._elsewhere and any(c.name == contract for c in self._proved)

    def adopt(self, other: ProofContext) -> None:
        """Take over the cones and invariants found in a context whose system this one's extends."""
        for name, cone in other.cones.items():
            self.cones.setdefault(name, cone)
        for key, found in other._invariants.items():
            self._invariants.setdefault(key, found)
        self._searched |= other._searched

    def record_invariants(self, cone: Cone, found: Sequence[Candidate]) -> None:
        """Record that conditions hold before every frame."""
        self._invariants[cone.leaves] = (*self._invariants.get(cone.leaves, ()), *found)

    def known_invariants(self, cone: Cone) -> list[Candidate]:
        """Return the invariants found so far that depend on nothing outside a cone."""
        known = (c for key, found in self._invariants.items() if key <= cone.leaves for c in found)
        return list({c.formula.get_id(): c for c in known}.values())

    def lemmas(self, cone: Cone) -> list[ContractFormula]:
        """Return the proved contracts that depend on nothing outside a cone."""
        return [claim for claim in self._proved if covers(cone, self.cones[claim.name])]

    def invariants(self, cone: Cone, budget: Budget) -> tuple[Candidate, ...]:
        """Return the invariants of a cone; each cone is searched only once."""
        key = cone.leaves  # it identifies a cone within its system
        if key not in self._searched:
            claims = [c for c in self.claims.values() if covers(cone, self.cones[c.name])]
            proved = self.lemmas(cone)
            unproved = [c for c in claims if c not in proved]
            search_budget = budget.scaled(_SHARE)
            guesses = not_refuted(cone, candidates(cone, tuple(claims)), search_budget)
            found = invariants(
                cone, guesses[:_MAX_GUESSES], unproved, [c.holds for c in proved], search_budget
            )
            self._searched.add(key)
            self.record_invariants(cone, found.conditions)
        return self._invariants[key]


# --- attempt ------------------------------------------------------------------------------------------

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
        return Proof(0, used) if answer is SolverAnswer.UNSAT else None

    def _break_first_frame(self) -> Trace | None:
        """Return a first frame that breaks the contract, if z3 has it at once."""
        if self._refuter is None or called_modules(self._cone):
            return None
        answer, model = self._context.single_frames.breaks_first(self._claim, self._budget)
        if answer is not SolverAnswer.SAT or model is None:
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
        match solve(self._cone.system, self._claim, lemmas, self._budget, share, guided=guided):
            case SpacerProof(guesses=guesses):
                known = [c.formula for c in self._known_conditions]
                found = invariants(self._cone, guesses, (), known, self._budget).conditions
                self._context.record_invariants(self._cone, found)
                self._know(found)
                return self.prove_in_one_frame()
            case Broken(frames=frames, safe_frames=safe_frames):
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
        induction = ContractInduction(self._cone, self._claim, self._known_conditions, self._budget)
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
