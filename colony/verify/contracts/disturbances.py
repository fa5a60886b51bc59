"""Proofs that a proved contract also holds while clients are late or lost, and while connections command.

With several actuators one may be idle, because its client is late or its server is down, while others act.
So each proved contract is proved once more in a system in which any actuators may be idle in any frame, and
with `on_loss degrade` any clients may be lost; then in one in which, besides, connections outside the
network command any actuators, within their bounds (`symbolic/encode.py`).

Most of these proofs are cheap: one frame, from the contract as it was proved, invariants that are known by
then, and contracts that were proved under the same disturbance. Memory of the program does not depend on what
is sent, so what was proved of it stays true.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property

from colony.ir import expression as ir
from colony.ir.program import Contract, Program, modules_that_can_be_lost
from colony.text.wording import counted
from colony.verify.contracts.assumptions import under
from colony.verify.contracts.attempt import Attempt, Proof, ProofContext
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.results import OverReals, ProofOptions, Proved, ProvedInTime, Trace, Unknown
from colony.verify.contracts.search import called_modules
from colony.verify.contracts.slicing import cone_of
from colony.verify.contracts.solver import Budget, Deadline
from colony.verify.symbolic.encode import claim_name, encode_disturbed
from colony.verify.symbolic.generalization import generalized
from colony.verify.symbolic.system import Disturbance, Inexact, Reason
from colony.verify.symbolic.unrolling import reasons_of

# --- explain -------------------------------------------------------------------------------------------
#
# Explanations of unknown results: the reasons, and advice.


_MAX_REASONS = 3


def explain_unknown(
    contract: Contract,
    reasons: Sequence[Reason],
    budget: Budget,
    *,
    frames_searched: int,
    spurious_models: int,
    trace: Trace | None,
) -> Unknown:
    """Return the result for a contract without a proof or refutation.

    Args:
        contract: The contract.
        reasons: Reasons why formulas about it are inexact.
        budget: Its budget.
        frames_searched: Number of frames searched for a counterexample.
        spurious_models: Number of models that break it, but not in the reference interpreter.
        trace: Run that breaks it if the Python modules answer as in this run; None if there is none.
    """
    abstracted = [r for r in reasons if r.kind is Inexact.ABSTRACTED]
    python = [r for r in reasons if r.kind is Inexact.PYTHON]
    because: list[str] = []
    if trace is not None:
        because.append(
            "it is reached if modules in Python answer as below, which they need not"
            if contract.reach
            else "it is broken if modules in Python answer as below, and the prover must assume that they can"
        )
        because += _reason_lines(python)
    elif budget.deadline.is_over():
        because.append("the time limit was reached")
    elif spurious_models and abstracted:
        because.append("only bounds and signs of the following are known, which is not enough:")
        because += _reason_lines(abstracted)
    elif spurious_models:
        verb = "reach" if contract.reach else "break"
        because.append(f"real numbers can {verb} it, but none of the floats that were tried do")
    elif budget.gave_up:
        because.append("z3 reached its limits without an answer")
    if trace is None:
        depth = counted(budget.options.depth, "frame")
        claim, verb = ("that no run reaches it", "reaches") if contract.reach else ("it", "breaks")
        because.append(
            f"{claim} does not follow from what held in the {depth} before, and no run of up to "
            f"{counted(frames_searched, 'frame')} {verb} it"
        )
    return Unknown(
        contract=contract,
        because=tuple(because),
        hint=_hint(budget, abstracted, spurious_models, trace),
        trace=trace,
    )


def _reason_lines(reasons: Sequence[Reason]) -> list[str]:
    """Return the first reasons, each with its location."""
    lines = [f"  {_location(r)}{r.text}" for r in reasons[:_MAX_REASONS]]
    omitted = len(reasons) - _MAX_REASONS
    return [*lines, f"  and {omitted} more"] if omitted > 0 else lines


def _location(reason: Reason) -> str:
    return f"{reason.span.place}: " if reason.span.source.text else ""


def _hint(budget: Budget, abstracted: Sequence[Reason], spurious_models: int, trace: Trace | None) -> str:
    if trace is not None:
        return "bound the module's command with a `limit` or a `range`, or test its class"
    if spurious_models and abstracted and not budget.deadline.is_over():
        return (
            "state what the contract needs to know about them as a condition in it, or test it with "
            "`--examples 10000`"
        )
    if budget.gave_up:
        return (
            "allow more time with `--timeout`, or split the contract: proved contracts help to prove others"
        )
    return (
        "state an invariant of its memory as a separate contract (proved contracts help to prove others), "
        "or search further with `--depth`"
    )


# --- disturbances --------------------------------------------------------------------------------------


Rounding = tuple[Reason, ...]
"""The places where a proof is about real numbers and floats may round; none if it is proved for floats."""

_SHARES = {Disturbance.LATE: 0.5, Disturbance.OPERATORS: 0.25}
"""Additional shares of a contract's budget for each disturbance."""

_FLOAT_SHARE = 0.25
"""Additional share of a budget for a proof that holds for floats."""

_STAGES = {Disturbance.LATE: "while clients are late", Disturbance.OPERATORS: "while operators command"}

_QUICK_SHARE = 0.03
"""Share of a full query's resources for a proof in one frame: there is one at once, or seldom at all."""

_DECISIONS = (ir.SentField, ir.WonBy, ir.IsCommanded, ir.IsIdle)
"""Expressions whose values any disturbance can change. Lost clients change those of `IsActive` as well."""


def with_operator_runs(program: Program, proved: Proved) -> Proved:
    """Return a proof without operators with a run in which a command from outside breaks the contract.

    None is searched for if the contract is `in time`.
    """
    if proved.contract.in_time:
        return proved
    program = under(program, proved.contract.assuming)
    trace = Refuter(program, proved.contract.name).search_runs(Disturbance.OPERATORS)
    return replace(proved, operator_runs=() if trace is None else (trace,))


class Confirmer:
    """Proves proved contracts of one program under disturbances. Stateful: remembers what it has proved.

    `usual` is the context in which contracts of `program` are proved while nothing disturbs them.
    """

    def __init__(
        self, program: Program, usual: ProofContext, options: ProofOptions, deadline: Deadline | None = None
    ) -> None:
        self._program = program
        self._usual = usual
        self._options = options
        self._deadline = Deadline() if deadline is None else deadline
        self._over_reals: dict[str, Rounding] = {}  # of all claims that are proved, by name
        self._inexact: dict[tuple[int, str], tuple[Reason, ...]] = {}  # by context and claim

    @property
    def proved(self) -> int:
        """Number of claims known to hold in every frame."""
        return len(self._over_reals)

    @cached_property
    def _context(self) -> ProofContext:
        context = ProofContext(encode_disturbed(self._usual.system))
        for name in self._over_reals:
            context.record_proof(name)
        return context

    @cached_property
    def _general(self) -> ProofContext:
        """The context of proofs that allow any rounding; what is proved for floats is known in it."""
        context = ProofContext(generalized(self._context.system))
        for name, over_reals in self._over_reals.items():
            if not over_reals:
                context.record_proof(name)
        return context

    def know(self, result: Proved | ProvedInTime | OverReals) -> None:
        """Use what was proved before."""
        proved = result.proof if isinstance(result, OverReals) else result
        if isinstance(proved, ProvedInTime):
            self._record(proved.contract.name, proved.in_time.over_reals)
            return
        late = () if proved.contract.in_time else (Disturbance.LATE,)
        disturbances = Disturbance if proved.operators else late
        for name in (proved.contract.name, *(claim_name(proved.contract.name, d) for d in disturbances)):
            self._record(name, proved.over_reals)

    def confirm(self, proved: Proved) -> Proved | ProvedInTime:
        """Prove a contract under each disturbance, within budgets of their own; not one `in time`."""
        contract = proved.contract
        self._record(contract.name, proved.over_reals)
        if contract.in_time:
            return proved
        if not self._depends_on_decisions(contract):
            return replace(proved, operators=True)
        with_operators = self._prove_quickly(contract, Disturbance.OPERATORS)
        if with_operators is not None:  # which includes that clients are late
            self._record(claim_name(contract.name, Disturbance.LATE), with_operators)
            return _with_over_reals(proved, with_operators, operators=True)
        late = self._prove_quickly(contract, Disturbance.LATE)
        found = self._attempt(contract, Disturbance.LATE) if late is None else late
        match found:
            case Trace():
                return ProvedInTime(contract=contract, in_time=proved, trace=found)
            case Unknown(because=because, hint=hint, trace=trace):
                return ProvedInTime(
                    contract=contract, in_time=proved, because=because, hint=hint, python_trace=trace
                )
            case _:
                return self._with_operators(_with_over_reals(proved, found, operators=False))

    def proof_context(self, contract: Contract, disturbance: Disturbance) -> ProofContext | None:
        """Return the context in which a contract is proved for floats under a disturbance.

        None if the disturbance changes nothing that the contract reads.
        """
        if not self._depends_on_decisions(contract):
            return None
        name, claims = claim_name(contract.name, disturbance), self._context.claims
        if claims[name].holds.eq(claims[contract.name].holds):
            return None
        return self._general if self._rounding_reasons([name]) else self._context

    def _with_operators(self, proved: Proved) -> Proved:
        """Try a longer proof with operators, where a quick one may have lacked invariants."""
        if not self._has_own_memory(claim_name(proved.contract.name, Disturbance.OPERATORS)):
            return proved
        found = self._attempt(proved.contract, Disturbance.OPERATORS)
        return _with_over_reals(proved, found, operators=True) if isinstance(found, tuple) else proved

    def _depends_on_decisions(self, contract: Contract) -> bool:
        can_be_lost = modules_that_can_be_lost(self._usual.system.program)
        kinds = (*_DECISIONS, ir.IsActive) if can_be_lost else _DECISIONS
        return any(isinstance(x, kinds) for x in ir.subexpressions(contract.expression))

    def _record(self, name: str, over_reals: Rounding) -> Rounding:
        """Record that a claim holds in every frame; return where its proof is about real numbers."""
        if name not in self._over_reals:
            self._over_reals[name] = over_reals
            if "_context" in self.__dict__:
                self._context.record_proof(name)
            if "_general" in self.__dict__ and not over_reals:
                self._general.record_proof(name)
        return self._over_reals[name]

    def _prove_quickly(self, contract: Contract, disturbance: Disturbance) -> Rounding | None:
        """Prove a claim in one frame; return None if there is no such proof."""
        name = claim_name(contract.name, disturbance)
        if name in self._over_reals:
            return self._over_reals[name]
        context, usual = self._context, self._context.claims[contract.name]
        context.adopt(self._usual)
        claim = context.claims[name]
        if claim.holds.eq(usual.holds):
            return self._record(name, self._over_reals[usual.name])
        context.cones[name] = cone_of(context.system, claim, usual)
        rounding = self._prove_for_floats(contract, name)
        if rounding is not None:
            return self._record(name, rounding)
        known = context.known_invariants(context.cones[name])
        attempt = Attempt(context, name, self._budget(1.0), known_invariants=known)
        if attempt.prove_in_one_frame(_QUICK_SHARE) is None:
            return None
        return self._record(name, self._rounding(name, attempt))

    def _prove_for_floats(self, contract: Contract, name: str) -> Rounding | None:
        """Return where rounding may still matter in a proof in one frame that allows any; None without one.

        It is not tried where no number can be rounded.
        """
        if not self._rounding_reasons([name]):
            return None
        general = self._general
        general.cones[name] = cone_of(general.system, general.claims[name], general.claims[contract.name])
        attempt = Attempt(general, name, self._budget(_FLOAT_SHARE))
        if attempt.prove_in_one_frame() is None:
            return None
        return self._rounding_reasons([name, *(c.name for c in attempt.lemmas)], general)

    def _attempt(self, contract: Contract, disturbance: Disturbance) -> Rounding | Trace | Unknown:
        """Prove or refute a claim over real numbers.

        Only for late clients is a counterexample searched for.
        """
        self._deadline.begin_stage(_STAGES[disturbance])
        name = claim_name(contract.name, disturbance)
        context, budget = self._context, self._budget(_SHARES[disturbance])
        refuter = self._refuter(contract, name) if disturbance is Disturbance.LATE else None
        known = context.known_invariants(context.cones[name])
        attempt = Attempt(context, name, budget, refuter, known)
        found = attempt.run()
        if found is None and attempt.python_trace is None and refuter is not None:
            found = refuter.search_runs(disturbance)
        match found:
            case Proof():
                return self._record(name, self._rounding(name, attempt))
            case Trace():
                return found
            case None:
                return explain_unknown(
                    contract,
                    self._reasons(context, name),
                    budget,
                    frames_searched=attempt.frames_searched,
                    spurious_models=0 if refuter is None else refuter.spurious_models,
                    trace=attempt.python_trace,
                )

    def _rounding(self, name: str, attempt: Attempt) -> Rounding:
        """Return the places where reals stand in for floats in a proof."""
        rounding = self._rounding_reasons([name, *(c.name for c in attempt.lemmas)])
        of_lemmas = (r for lemma in attempt.lemmas for r in self._over_reals[lemma.name])
        return tuple(dict.fromkeys((*rounding, *of_lemmas)))

    def _rounding_reasons(self, names: Iterable[str], context: ProofContext | None = None) -> Rounding:
        """Return the places where reals stand in for floats in claims."""
        of_claims = (r for name in names for r in self._reasons(context or self._context, name))
        return tuple(dict.fromkeys(r for r in of_claims if r.kind is Inexact.ROUNDING))

    def _reasons(self, context: ProofContext, name: str) -> tuple[Reason, ...]:
        """Return the reasons of all inexact terms that a claim depends on, computed when first needed."""
        if context is self._context and name in self._usual.claims:
            return self._usual.claims[name].inexact
        key = (id(context), name)
        if key not in self._inexact:
            self._inexact[key] = reasons_of(context.system, context.claims[name].holds)
        return self._inexact[key]

    def _has_own_memory(self, name: str) -> bool:
        """Return True if a claim depends on memory that it does not depend on while nothing disturbs it.

        Only then can its proof need invariants that the contract's did not need.
        """
        usual_cells = {cell.name for cell in self._usual.system.cells}
        return any(cell.name not in usual_cells for cell in self._context.cones[name].cells)

    def _refuter(self, contract: Contract, name: str) -> Refuter:
        context = self._context
        late = context.system.disturbances[Disturbance.LATE]
        return Refuter(
            self._program, contract.name, called_modules(context.cones[name]), late, deadline=self._deadline
        )

    def _budget(self, share: float) -> Budget:
        return Budget(self._options, self._deadline, share)


def _with_over_reals(proved: Proved, over_reals: Rounding, *, operators: bool) -> Proved:
    """Return a proof with the places where the proofs under disturbances are about real numbers."""
    together = tuple(dict.fromkeys((*proved.over_reals, *over_reals)))
    return replace(proved, over_reals=together, operators=operators)
