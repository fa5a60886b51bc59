"""Proofs that a proved contract also holds while clients are late, and while somebody outside commands.

With several actuators one may be idle, because its client is late or its server is down, while others act.
So each proved contract is proved once more in a system in which any actuators may be idle in any frame, and
with `on_loss degrade` any clients may be lost; then in one in which, besides, somebody outside the network
commands any actuators, within their bounds (`symbolic/disturbing.py`).

Most of these proofs are cheap: one frame, from the contract as it was proved, invariants that are known by
then, and contracts that were proved under the same disturbance. Memory of the program does not depend on what
is sent, so what was proved of it stays true.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

from colony.ir import expression as ir
from colony.ir.program import Contract, modules_that_can_be_lost
from colony.verify.contracts.attempt import Attempt, Proof
from colony.verify.contracts.cone import cone_of
from colony.verify.contracts.explain import explain_unknown
from colony.verify.contracts.proof_context import ProofContext
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.results import Options, Proved, ProvedInTime, Trace, Unknown
from colony.verify.contracts.search import called_modules
from colony.verify.contracts.solver import Budget, Clock
from colony.verify.symbolic.disturbing import claim_name, encode_disturbed
from colony.verify.symbolic.generalization import generalize
from colony.verify.symbolic.reasons import rounding_reasons
from colony.verify.symbolic.system import Disturbance, Reason

_SHARES = {Disturbance.LATE: 0.5, Disturbance.OPERATORS: 0.25}
"""Additional shares of a contract's budget for each disturbance."""

_FLOAT_SHARE = 0.25
"""Additional share of a budget for a proof that holds for floats."""

_QUICK_SHARE = 0.05
"""Share of a full query's resources for a proof in one frame: there is one at once, or seldom at all."""

_DECISIONS = (ir.SentField, ir.WonBy, ir.IsCommanded, ir.IsIdle)
"""What any disturbance can change in a contract. Lost clients change what is active as well."""


class Confirmer:
    """Proves proved contracts of one program under disturbances. Stateful: remembers what it has proved.

    `usual` is the context in which contracts are proved while nothing disturbs them. `proved` is the number
    of proofs under a disturbance.
    """

    def __init__(self, usual: ProofContext, options: Options, clock: Clock | None = None) -> None:
        self._usual = usual
        self._options = options
        self._clock = clock
        self._over_reals: dict[str, tuple[Reason, ...]] = {}  # of all claims that are proved, by name
        self.proved = 0

    @cached_property
    def _context(self) -> ProofContext:
        context = ProofContext(encode_disturbed(self._usual.system))
        for name in self._over_reals:
            context.record_proof(name)
        return context

    @cached_property
    def _general(self) -> ProofContext:
        """The context of proofs that allow any rounding; what is proved for floats is known in it."""
        context = ProofContext(generalize(self._context.system))
        for name, over_reals in self._over_reals.items():
            if not over_reals:
                context.record_proof(name)
        return context

    def confirm(self, proved: Proved) -> Proved | ProvedInTime:
        """Prove a contract under each disturbance, within budgets of their own."""
        contract = proved.contract
        self._record(contract.name, proved.over_reals)
        if not self._depends_on_decisions(contract):
            return replace(proved, operators=True)
        found = self._prove(contract, Disturbance.LATE)
        match found:
            case Trace():
                return ProvedInTime(contract=contract, in_time=proved, trace=found)
            case Unknown(because=because, hint=hint, trace=trace):
                return ProvedInTime(
                    contract=contract, in_time=proved, because=because, hint=hint, python_trace=trace
                )
            case _:
                pass
        over_reals = (*proved.over_reals, *found)
        with_operators = self._prove(contract, Disturbance.OPERATORS)
        if isinstance(with_operators, tuple):
            over_reals = (*over_reals, *with_operators)
        return replace(
            proved, over_reals=tuple(dict.fromkeys(over_reals)), operators=isinstance(with_operators, tuple)
        )

    def _depends_on_decisions(self, contract: Contract) -> bool:
        can_be_lost = modules_that_can_be_lost(self._usual.system.program)
        kinds = (*_DECISIONS, ir.IsActive) if can_be_lost else _DECISIONS
        return any(isinstance(x, kinds) for x in ir.subexpressions(contract.expression))

    def _record(self, name: str, over_reals: tuple[Reason, ...]) -> None:
        """Record that a claim holds in every frame."""
        if name in self._over_reals:
            return
        self._over_reals[name] = over_reals
        if "_context" in self.__dict__:
            self._context.record_proof(name)
        if "_general" in self.__dict__ and not over_reals:
            self._general.record_proof(name)

    def _prove(self, contract: Contract, disturbance: Disturbance) -> tuple[Reason, ...] | Trace | Unknown:
        """Return where a proof is about real numbers and floats may round; or a run; or why there is neither.

        Only of late clients runs are sought.
        """
        name = claim_name(contract.name, disturbance)
        context, usual = self._context, self._context.claims[contract.name]
        claim = context.claims[name]
        if name in self._over_reals:
            return self._over_reals[name]
        context.cones[name] = cone_of(context.system, claim, usual)
        rounding = (
            self._over_reals[usual.name]
            if claim.holds.eq(usual.holds)
            else self._prove_for_floats(contract, name)
        )
        if rounding is None:
            found = self._attempt(contract, name, disturbance)
            if not isinstance(found, tuple):
                return found
            rounding = found
        self.proved += 1
        self._record(name, rounding)
        return rounding

    def _prove_for_floats(self, contract: Contract, name: str) -> tuple[Reason, ...] | None:
        """Return where rounding may still matter in a proof in one frame that allows any; None without one.

        It is not tried where no number can be rounded.
        """
        if not rounding_reasons([self._context.claims[name]]):
            return None
        general = self._general
        general.cones[name] = cone_of(general.system, general.claims[name], general.claims[contract.name])
        attempt = Attempt(general, name, self._budget(_FLOAT_SHARE))
        if attempt.prove_in_one_frame() is None:
            return None
        return rounding_reasons([general.claims[name], *attempt.lemmas])

    def _attempt(
        self, contract: Contract, name: str, disturbance: Disturbance
    ) -> tuple[Reason, ...] | Trace | Unknown:
        """Prove or refute a claim over real numbers."""
        context, budget = self._context, self._budget(_SHARES[disturbance])
        context.adopt_invariants(self._usual)
        refuter = self._refuter(contract, name) if disturbance is Disturbance.LATE else None
        known = context.known_invariants(context.cones[name])
        attempt = Attempt(context, name, budget, refuter, known)
        if refuter is None and not self._has_own_memory(name):
            found: Proof | Trace | None = attempt.prove_in_one_frame(_QUICK_SHARE)
        else:
            found = attempt.run()
        if found is None and attempt.python_trace is None and refuter is not None:
            found = refuter.search_random_runs()
        match found:
            case Proof():
                rounding = rounding_reasons([context.claims[name], *attempt.lemmas])
                of_lemmas = (r for lemma in attempt.lemmas for r in self._over_reals[lemma.name])
                return tuple(dict.fromkeys((*rounding, *of_lemmas)))
            case Trace():
                return found
            case None:
                return explain_unknown(
                    contract,
                    context.claims[name].inexact,
                    budget,
                    frames_searched=attempt.frames_searched,
                    spurious_models=0 if refuter is None else refuter.spurious_models,
                    trace=attempt.python_trace,
                )

    def _has_own_memory(self, name: str) -> bool:
        """Return True if a claim depends on memory that it does not depend on while nothing disturbs it.

        Only then can its proof need invariants that the contract's did not need.
        """
        usual_cells = {cell.name for cell in self._usual.system.cells}
        return any(cell.name not in usual_cells for cell in self._context.cones[name].cells)

    def _refuter(self, contract: Contract, name: str) -> Refuter:
        context = self._context
        late = context.system.disturbances[Disturbance.LATE]
        return Refuter(context.system.program, contract.name, called_modules(context.cones[name]), late)

    def _budget(self, share: float) -> Budget:
        return Budget(self._options, self._clock).scaled(share)
