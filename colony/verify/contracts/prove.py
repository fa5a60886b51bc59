"""The prover of contracts: proved, only with clients in time, over real numbers, refuted, or unknown.

It tries a contract in a single frame with arbitrary memory, then with invariants of its memory
(`candidates.py`), then by k-induction (`search.py`), alternating with a search for counterexamples of growing
length (`search.py`), which is also the base case. A counterexample counts only if it breaks the contract in
the reference interpreter (`refute.py`).

There are up to four encodings of a program. The usual one comes first. The precise one states products and
quotients of variables exactly; it is used if the usual one does not suffice and they matter. The general one
allows any rounding; it is used to confirm proofs in which reals stand in for floats, and after it the close
one, which allows any that is as close as floats are. As the general one is the cheapest, a proof in a single
frame is tried in it first.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

from colony.ir.program import Contract, Program, assumptions, without_assumed
from colony.verify.contracts.assumptions import has_limits, related, under
from colony.verify.contracts.attempt import Attempt, Proof, ProofContext
from colony.verify.contracts.candidates import Candidate, for_floats, invariants
from colony.verify.contracts.concrete_runs import LongRuns, Replay, evaluations
from colony.verify.contracts.disturbances import Confirmer, explain_unknown
from colony.verify.contracts.kept import ProofCache
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.results import (
    RESOURCES_PER_SECOND,
    OverReals,
    ProofOptions,
    Proved,
    ProvedInTime,
    Refuted,
    Result,
    Trace,
    Unknown,
    rank,
)
from colony.verify.contracts.search import called_modules
from colony.verify.contracts.slicing import slice_of
from colony.verify.contracts.solver import Budget, Deadline
from colony.verify.contracts.whole import whole_numbers
from colony.verify.symbolic.encode import encode
from colony.verify.symbolic.generalization import generalize
from colony.verify.symbolic.system import ContractFormula, Disturbance, Operation, Reason, Shape
from colony.verify.symbolic.unrolling import rounding_reasons

_GENERAL_SHARE = 0.25
"""Additional share of a budget for a proof that holds for floats."""

_COST_OF_ENCODING = RESOURCES_PER_SECOND // 7500
"""Cost of an expression that is encoded, in z3's resource units."""

_MAX_GUESSES = 300
"""Maximum number of invariants that are guessed for floats."""

_CLOSE_DEPTH = 2
"""Maximum depth in the close system: numbers grow by 51 digits a frame, which z3's resource units ignore."""

OnResult = Callable[["ContractProver", Result], None]
"""A function that receives a result with the prover that has just found it."""

_NONLINEAR = (Operation.PRODUCT, Operation.QUOTIENT)


def prove_contracts(program: Program, options: ProofOptions | None = None) -> tuple[Result, ...]:
    """Return the result of every contract, in the order written."""
    names = [c.name for c in program.contracts]
    return tuple(in_order(program, results(program, names, options)))


def in_order(program: Program, found: Iterable[Result]) -> list[Result]:
    """Return results in the order in which the contracts are written."""
    by_name = {result.contract.name: result for result in found}
    return [by_name[c.name] for c in (*program.contracts, *program.reaches) if c.name in by_name]


def results(
    program: Program,
    names: list[str],
    options: ProofOptions | None = None,
    shapes: dict[str, Shape] | None = None,
    cache: ProofCache | None = None,
    on_result: OnResult | None = None,
    deadline: Deadline | None = None,
    parts_after: int = 0,
) -> Iterator[Result]:
    """Yield the result of each contract in `names`, as soon as it is known.

    A contract that is not proved is tried with what limits say of `last...`, with the assumptions that are
    declared above it, and with all of the program; a proof rests on as few of them as were found. The
    arguments are those of `_results`.
    """
    required, world = without_assumed(program), [a.name for a in assumptions(program)]
    limited = has_limits(program)
    if not world and not limited:
        yield from _results(required, names, options, shapes, cache, on_result, deadline, parts_after)
        return
    deadline = Deadline() if deadline is None else deadline
    own_cache = None if cache is None else cache.about(required, names)
    proved, left = list[Result](), list[Result]()
    resting: list[tuple[Proved, Collection[str]]] = []  # proofs with the assumptions that they rest on
    later = parts_after + len(names)
    for result in _results(required, names, options, shapes, own_cache, on_result, deadline, later):
        (proved if isinstance(result, Proved) else left).append(result)
        if isinstance(result, Proved):
            yield result

    def attempt(name: str, assuming: Collection[str], parts: int) -> tuple[ContractProver | None, Result]:
        """Return the result of a contract under some assumptions, with its prover if it was not known."""
        helpful = [*proved, *(r for r, needed in resting if set(needed) <= set(assuming))]
        made, asked = under(program, assuming), [*(r.contract.name for r in helpful), name]
        own_cache = None if cache is None else cache.about(made, asked)
        provers: list[ContractProver] = []
        found = _results(
            made, asked, options, None, own_cache, lambda p, _: provers.append(p), deadline, parts, helpful
        )
        *_, result = (r for r in found if r.contract.name == name)
        return (provers[-1] if provers else None), explained(required, result)

    for number, before in enumerate(left):
        name, parts = before.contract.name, parts_after + len(left) - number - 1
        declared = [c.name for c in program.contracts]
        above = [a for a in world if a in declared[: declared.index(name)]]
        needed: Collection[str]
        for needed in dict.fromkeys(map(tuple, ([], above, world) if limited else (above or world, world))):
            prover, result = attempt(name, needed, parts)
            if isinstance(result, Proved):
                break
        candidates = [related(program, name), *([a] for a in needed)]
        for i, tried in enumerate(candidates if rank(result) > rank(before) else ()):
            fewer = [a for a in needed if (a in tried if i == 0 else a not in tried)]
            if len(fewer) == len(needed):
                continue
            with_fewer = attempt(name, fewer, parts)
            if rank(with_fewer[1]) >= rank(result):
                (prover, result), needed = with_fewer, fewer
        if rank(before) and rank(result) <= rank(before):
            result = before
        elif prover is not None and on_result is not None:
            on_result(prover, result)
        if isinstance(result, Proved):
            resting.append((result, needed))
        yield result


def explained(program: Program, result: Result) -> Result:
    """Return a result under assumptions with its run explained by the contract alone."""
    match result:
        case Refuted(trace=trace):
            return replace(result, trace=_explained_run(program, result.contract.name, trace))
        case ProvedInTime(trace=Trace() as trace):
            return replace(result, trace=_explained_run(program, result.contract.name, trace))
        case _:
            return result


def _explained_run(program: Program, contract: str, trace: Trace) -> Trace:
    replay = Replay(program, contract)
    facts = replay.facts(trace.snapshots)
    return replace(trace, unknown=facts.unknown, found=facts.found, cause=replay.cause(trace.snapshots))


def _results(
    program: Program,
    names: list[str],
    options: ProofOptions | None,
    shapes: dict[str, Shape] | None,
    cache: ProofCache | None,
    on_result: OnResult | None,
    deadline: Deadline | None,
    parts_after: int,
    proved: Sequence[Result] = (),
) -> Iterator[Result]:
    """Yield the result of each contract in `names`, as soon as it is known; `proved` are known to be so.

    `shapes` receives those of the program's memory. What `cache` knows is not proved again; `on_result`
    receives all other results.

    Proved contracts help to prove the others: one that stays unknown is tried again at the end if others were
    proved after it, so the order in which contracts are written matters little. Each may use an equal share
    of what `deadline` has left, of which `parts_after` shares are kept for what follows.
    """
    asked = [c for c in program.contracts if c.name in names]
    known = {} if cache is None else cache.known(asked)
    known |= {result.contract.name: result for result in proved}
    deadline = Deadline() if deadline is None else deadline
    encoded = slice_of(program, *asked)
    prover = ContractProver(program, options or ProofOptions(), deadline, shapes=shapes, encoded=encoded)

    def found(result: Result) -> Result:
        if cache is not None:
            cache.keep(result)
        if on_result is not None:
            on_result(prover, result)
        return result

    open_results: list[tuple[int, Result]] = []
    for number, contract in enumerate(asked):
        is_known = contract.name in known
        deadline.begin_part(len(asked) - number + parts_after, contract.name)
        result = known[contract.name] if is_known else prover.prove_disturbed(contract)
        if is_known:
            prover.know(result)
        if _is_open(result):
            open_results.append((0 if is_known else prover.proofs, result))
        else:
            yield result if is_known else found(result)
    for number, (proofs_before, result) in enumerate(open_results):
        deadline.begin_part(len(open_results) - number + parts_after, result.contract.name)
        if result.contract.name in known:
            yield result
        else:
            yield found(prover.prove_disturbed(result.contract) if prover.proofs > proofs_before else result)


def _is_open(result: Result) -> bool:
    """Return True if proofs of other contracts may improve a result."""
    return isinstance(result, Unknown | OverReals) or (
        isinstance(result, ProvedInTime) and result.trace is None
    )


class ContractProver:
    """Proves one program's contracts one after the other. Stateful: remembers the contracts proved so far.

    `deadline` limits all of the work. `known` are proved shapes of numbers in memory, `long_runs`
    those of the program, if another prover has them. `shapes` are those found for programs with the same
    memory; what is found is added. `encoded` is the part of the program that the contracts to be proved
    depend on.
    """

    def __init__(
        self,
        program: Program,
        options: ProofOptions,
        deadline: Deadline | None = None,
        known: Mapping[str, Shape] | None = None,
        long_runs: LongRuns | None = None,
        shapes: dict[str, Shape] | None = None,
        encoded: Program | None = None,
    ) -> None:
        self._known = known
        self._encoded = program if encoded is None else encoded
        self._known_results: list[Proved | ProvedInTime | OverReals] = []
        self._shapes = {} if shapes is None else shapes
        self._program = program
        self._options = options
        self._deadline = Deadline() if deadline is None else deadline
        self._results: dict[str, Proved] = {}
        self._over_reals: dict[str, tuple[Reason, ...]] = {}
        self._exact: set[str] = set()  # contracts that are proved with more whole numbers
        self._long_runs = LongRuns(program) if long_runs is None else long_runs

    @cached_property
    def _usual(self) -> ProofContext:
        self._deadline.begin_stage("encoding the program")  # which counts as loading
        system = encode(self._encoded, known=self._known or {}, guess=self._shapes)
        self._shapes |= {} if self._known else system.shapes
        context = ProofContext(system)
        for name in self._results:
            context.record_proof(name)
        return context

    @cached_property
    def _with_whole_numbers(self) -> ContractProver | None:
        """The prover with more numbers known to be whole and bounded; None if there are no more."""
        if self._known is not None or self._deadline.is_over():
            return None
        self._deadline.begin_stage("whole numbers in memory")
        found = whole_numbers(self._encoded, self._usual.system, self._options, self._deadline)
        if not found:
            return None
        return ContractProver(
            self._program, self._options, self._deadline, found, self._long_runs, encoded=self._encoded
        )

    @cached_property
    def _precise(self) -> ProofContext:
        self._begin_encoding("encoding products and quotients exactly")
        return ProofContext(encode(self._encoded, precise=True, known=self._usual.system.shapes))

    @cached_property
    def _general(self) -> ProofContext:
        self._begin_encoding("encoding any rounding")
        return self._with_float_lemmas(ProofContext(generalize(self._usual.system)))

    @cached_property
    def _close(self) -> ProofContext:
        self._begin_encoding("encoding close rounding")
        return self._with_float_lemmas(ProofContext(generalize(self._usual.system, close=True)))

    def _with_float_lemmas(self, context: ProofContext) -> ProofContext:
        """Return a context of floats that knows what is proved for them."""
        for name, over_reals in self._over_reals.items():
            if not over_reals:
                context.record_lemma(name)
        return context

    def _record_over_reals(self, name: str, over_reals: tuple[Reason, ...]) -> None:
        """Record where the proof of a contract has reals for floats; without any, it is one of floats."""
        self._over_reals[name] = over_reals
        for context in (vars(self).get("_general"), vars(self).get("_close")):
            if context is not None and not over_reals:
                context.record_lemma(name)

    def _begin_encoding(self, stage: str) -> None:
        self._deadline.begin_stage(stage)
        self._deadline.charge_all(_COST_OF_ENCODING * evaluations(self._encoded))

    @cached_property
    def _confirmer(self) -> Confirmer:
        confirmer = Confirmer(self._program, self._usual, self._options, self._deadline)
        for result in self._known_results:
            confirmer.know(result)
        return confirmer

    @property
    def proofs(self) -> int:
        """Number of proofs so far, those under a disturbance included."""
        return len(self._results) + self._confirmer.proved

    def know(self, result: Result) -> None:
        """Use what was proved before."""
        if isinstance(result, Refuted | Unknown):
            return
        proved = result if isinstance(result, Proved) else result.in_time
        name = proved.contract.name
        self._results[name] = proved
        self._record_over_reals(name, proved.over_reals)
        self._known_results.append(result)
        if "_usual" in vars(self):
            self._usual.record_proof(name)
        if "_confirmer" in vars(self):
            self._confirmer.know(result)

    def prove_disturbed(self, contract: Contract) -> Result:
        """Prove or refute a contract, also while clients are late or lost, and while connections command."""
        found = self._prove_disturbed(contract)
        if not isinstance(found, OverReals) or self._with_whole_numbers is None:
            return found
        exact = self._with_whole_numbers.prove_disturbed(contract)
        if isinstance(exact, Unknown):
            return found
        self._exact.add(contract.name)
        return exact

    def _prove_disturbed(self, contract: Contract) -> Result:
        known = self._results.get(contract.name)
        result = self.prove(contract) if known is None or known.over_reals else known
        if not isinstance(result, Proved):
            return result
        found = OverReals(contract=contract, proof=self._confirmer.confirm(result))
        return found if found.in_time.over_reals else found.proof

    def prove(self, contract: Contract) -> Proved | Refuted | Unknown:
        """Prove or refute a contract while every client is in time, within a budget of its own."""
        float_proof = (
            self._prove_for_floats(contract, one_frame_only=True) if self._uses_reals(contract) else None
        )
        if float_proof is not None:
            return self._record_proved(contract, self._usual, *float_proof)
        budget = Budget(self._options, self._deadline)
        called = called_modules(self._usual.cones[contract.name])
        refuter = Refuter(
            self._program, contract.name, called, long_runs=self._long_runs, deadline=self._deadline
        )
        attempt = Attempt(self._usual, contract.name, budget, refuter)
        context, found = self._usual, attempt.run()
        frames_searched = attempt.frames_searched
        is_open = found is None and attempt.python_trace is None and not self._deadline.is_over()
        if is_open and self._is_nonlinear(contract.name):
            attempt = Attempt(self._precise, contract.name, budget.scaled(), refuter)
            context, found = self._precise, attempt.run()
            frames_searched = max(frames_searched, attempt.frames_searched)
        if found is None and attempt.python_trace is None:
            found = refuter.search_runs()
        match found:
            case Proof():
                return self._confirm_for_floats(contract, context, found, attempt.lemmas, refuter)
            case Trace():
                return Refuted(contract=contract, trace=found)
            case None:
                return explain_unknown(
                    contract,
                    context.claims[contract.name].inexact,
                    budget,
                    frames_searched=frames_searched,
                    spurious_models=refuter.spurious_models,
                    trace=attempt.python_trace,
                )

    def proof_contexts(
        self, proved: Proved | ProvedInTime
    ) -> Sequence[tuple[ProofContext, Disturbance | None]]:
        """Return the context in which a contract is proved for floats, and that under a disturbance."""
        name = proved.contract.name
        if name in self._exact and self._with_whole_numbers is not None:
            return self._with_whole_numbers.proof_contexts(proved)
        made = (vars(self).get(context) for context in ("_general", "_close", "_precise", "_usual"))
        in_time = next((c, None) for c in made if c is not None and c.has_proved(name))
        if isinstance(proved, ProvedInTime) or proved.contract.in_time:
            return [in_time]
        disturbance = Disturbance.OPERATORS if proved.operators else Disturbance.LATE
        context = self._confirmer.proof_context(proved.contract, disturbance)
        return [in_time] if context is None else [in_time, (context, disturbance)]

    def _uses_reals(self, contract: Contract) -> bool:
        """Return True if reals stand in for floats in a contract."""
        return bool(rounding_reasons([self._usual.claims[contract.name]]))

    def _is_nonlinear(self, contract: str) -> bool:
        """Return True if a contract depends on products or quotients known only by bounds and signs."""
        visited = self._usual.cones[contract].visited
        return any(
            a.operation in _NONLINEAR and a.constant.get_id() in visited
            for a in self._usual.system.auxiliaries
        )

    def _confirm_for_floats(
        self,
        contract: Contract,
        context: ProofContext,
        proof: Proof,
        lemmas: list[ContractFormula],
        refuter: Refuter,
    ) -> Proved | Refuted:
        """Check whether a proof holds for floats, bit for bit: floats may break what holds for reals."""
        rounding = self._with_lemmas(rounding_reasons([context.claims[contract.name], *lemmas]), lemmas)
        float_proof = (
            self._prove_for_floats(contract, used=_used(context, contract, proof))
            or self._prove_for_floats(contract, close=True)
            if rounding
            else None
        )
        if float_proof is not None:
            proof, rounding = float_proof
        elif rounding:
            trace = refuter.search_runs()
            if trace is not None:
                return Refuted(contract=contract, trace=trace)
        return self._record_proved(contract, context, proof, rounding)

    def _record_proved(
        self, contract: Contract, context: ProofContext, proof: Proof, rounding: tuple[Reason, ...]
    ) -> Proved:
        """Record a contract as proved."""
        self._record_over_reals(contract.name, rounding)
        for proof_context in dict.fromkeys((self._usual, context)):
            proof_context.record_proof(contract.name)
        result = Proved(contract=contract, k=proof.k, invariants=proof.conditions_used, over_reals=rounding)
        self._results[contract.name] = result
        return result

    def _with_lemmas(self, rounding: tuple[Reason, ...], lemmas: list[ContractFormula]) -> tuple[Reason, ...]:
        """Return `rounding`, and the places where the proofs of the lemmas used reals for floats.

        Those proofs may be in the precise system, which rounds where the usual one has only bounds.
        """
        of_lemmas = (r for lemma in lemmas for r in self._over_reals[lemma.name])
        return tuple(dict.fromkeys((*rounding, *of_lemmas)))

    def _prove_for_floats(
        self,
        contract: Contract,
        *,
        one_frame_only: bool = False,
        close: bool = False,
        used: Sequence[Candidate] = (),
    ) -> tuple[Proof, tuple[Reason, ...]] | None:
        """Return a proof that allows any rounding, and the places where rounding may still matter.

        With `one_frame_only`, try only a proof in a single frame; with `close`, one in the close system.
        `used` are the invariants of a proof over reals.
        """
        if self._deadline.is_over():
            return None
        general, options = self._general, self._options
        if close:
            frames = min(options.max_frames, _CLOSE_DEPTH)
            general = self._close
            options = replace(options, depth=min(options.depth, _CLOSE_DEPTH), max_frames=frames)
        self._deadline.begin_stage("a proof for floats")
        budget = Budget(options, self._deadline, _GENERAL_SHARE)
        known = self._hold_in_floats(contract, used) if used else ()
        attempt = Attempt(general, contract.name, budget, known_invariants=known, asks_spacer=not close)
        proof = attempt.prove_in_one_frame() if one_frame_only else attempt.run()
        if not isinstance(proof, Proof):
            return None
        general.record_proof(contract.name)
        return proof, rounding_reasons([general.claims[contract.name], *attempt.lemmas])

    def _hold_in_floats(self, contract: Contract, used: Sequence[Candidate]) -> Sequence[Candidate]:
        """Return invariants that hold for any rounding, from those of a proof over reals."""
        cone = self._general.cones[contract.name]
        lemmas = [c.holds for c in self._general.lemmas(cone)]
        budget = Budget(self._options, self._deadline, _GENERAL_SHARE)
        found = invariants(cone, for_floats(cone, used)[:_MAX_GUESSES], (), lemmas, budget).conditions
        self._general.record_invariants(cone, found)
        return found


def _used(context: ProofContext, contract: Contract, proof: Proof) -> list[Candidate]:
    """Return the invariants that a proof uses."""
    known = context.known_invariants(context.cones[contract.name])
    return [c for c in known if c.text in proof.conditions_used]
