"""Each contract of a program: proved, refuted, or unknown and why.

A contract is first looked at in one frame alone, with any memory; then with invariants of its memory
(`houdini.py`); then by k-induction (`induction.py`), in turn with a search for counterexamples of growing
length (`search.py`), which is also the base of the induction. What the search finds is believed only when it
breaks the contract in the reference interpreter (`refute.py`). This is done for up to three systems of
formulas: the usual one; where that is not enough and products or quotients of what varies matter, one that
states them as such; and, where reals stood in for floats, one in which rounding may do anything. In the last
one there is less to reason about, so that what follows there in one frame is asked first.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property

from colony.ir.program import Contract, Program
from colony.verify.contracts.attempt import Attempt, Proof
from colony.verify.contracts.explain import unknown
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.results import Options, Proved, Refuted, Result, Trace, Unknown
from colony.verify.contracts.setting import Setting
from colony.verify.contracts.solver import Budget, Clock
from colony.verify.symbolic.encode import encode
from colony.verify.symbolic.generalization import generalized
from colony.verify.symbolic.system import Claim, Inexact, Operation, Reason

_GENERAL = 0.25
"""The part of a budget that may go, besides, into a proof that holds for floats."""

_NONLINEAR = (Operation.PRODUCT, Operation.QUOTIENT)


def prove_contracts(
    program: Program, options: Options | None = None, clock: Clock | None = None
) -> tuple[Result, ...]:
    """Return the result of every contract, in the order written. Deterministic without a `clock`."""
    names = [c.name for c in program.contracts]
    return tuple(in_order(program, results(program, names, options, clock)))


def in_order(program: Program, found: Iterable[Result]) -> list[Result]:
    """Return results in the order in which the contracts are written."""
    by_name = {result.contract.name: result for result in found}
    return [by_name[c.name] for c in program.contracts if c.name in by_name]


def results(
    program: Program, names: list[str], options: Options | None = None, clock: Clock | None = None
) -> Iterator[Result]:
    """Yield the result of each contract in `names`, as soon as it is known.

    What is proved helps the rest: a contract that stays unknown is tried once more in the end if others were
    proved after it, so that the order in which contracts are written matters little.
    """
    prover = Prover(program, options or Options(), clock)
    unknown: list[tuple[int, Unknown]] = []
    for contract in program.contracts:
        if contract.name in names:
            result = prover.prove(contract)
            if isinstance(result, Unknown):
                unknown.append((prover.proved, result))
            else:
                yield result
    for proved_before, result in unknown:
        yield prover.prove(result.contract) if prover.proved > proved_before else result


class Prover:
    """A prover of one program's contracts, one after the other. Mutable: what was proved, and how many."""

    def __init__(self, program: Program, options: Options, clock: Clock | None = None) -> None:
        self._program = program
        self._options = options
        self._clock = clock
        self.proved = 0
        self._over_reals: dict[str, tuple[Reason, ...]] = {}

    @cached_property
    def _usual(self) -> Setting:
        return Setting(encode(self._program))

    @cached_property
    def _precise(self) -> Setting:
        return Setting(encode(self._program, precise=True))

    @cached_property
    def _general(self) -> Setting:
        return Setting(generalized(self._usual.system))

    def prove(self, contract: Contract) -> Result:
        """Prove or refute a contract, within a budget of its own."""
        exact = self._exact(contract, at_once=True) if self._rounds(contract) else None
        if exact is not None:
            return self._kept(contract, self._usual, *exact)
        budget = Budget(self._options, self._clock)
        refuter = Refuter(self._program, contract.name)
        attempt = Attempt(self._usual, contract.name, budget, refuter)
        setting, found = self._usual, attempt.run()
        searched = attempt.searched
        if found is None and attempt.if_python is None and self._is_nonlinear(contract.name):
            attempt = Attempt(self._precise, contract.name, budget.part(), refuter)
            setting, found = self._precise, attempt.run()
            searched = max(searched, attempt.searched)
        if found is None and attempt.if_python is None:
            found = refuter.drawn()
        match found:
            case Proof():
                return self._proved(contract, setting, found, attempt.lemmas, refuter)
            case Trace():
                return Refuted(contract=contract, trace=found)
            case None:
                return unknown(
                    contract,
                    setting.claims[contract.name].inexact,
                    budget,
                    searched=searched,
                    imagined=refuter.imagined,
                    trace=attempt.if_python,
                )

    def _rounds(self, contract: Contract) -> bool:
        """Return True if reals stand in for floats in a contract."""
        return bool(_rounding([self._usual.claims[contract.name]]))

    def _is_nonlinear(self, contract: str) -> bool:
        """Return True if a contract depends on products or quotients with only known bounds and signs."""
        met = self._usual.cones[contract].visited
        return any(
            a.operation in _NONLINEAR and a.constant.get_id() in met for a in self._usual.system.auxiliaries
        )

    def _proved(
        self, contract: Contract, setting: Setting, proof: Proof, lemmas: list[Claim], refuter: Refuter
    ) -> Proved | Refuted:
        """See whether a proof holds bit for bit: floats may break what reals keep."""
        rounding = self._rests(_rounding([setting.claims[contract.name], *lemmas]), lemmas)
        exact = self._exact(contract) if rounding else None
        if exact is not None:
            proof, rounding = exact
        elif rounding:
            trace = refuter.drawn()
            if trace is not None:
                return Refuted(contract=contract, trace=trace)
        return self._kept(contract, setting, proof, rounding)

    def _kept(
        self, contract: Contract, setting: Setting, proof: Proof, rounding: tuple[Reason, ...]
    ) -> Proved:
        """Take note of a contract that is proved."""
        self.proved += 1
        self._over_reals[contract.name] = rounding
        for every in dict.fromkeys((self._usual, setting)):
            every.proved(contract.name)
        return Proved(contract=contract, k=proof.k, invariants=proof.used, over_reals=rounding)

    def _rests(self, rounding: tuple[Reason, ...], lemmas: list[Claim]) -> tuple[Reason, ...]:
        """Return `rounding`, and where reals stood in for floats when the lemmas were proved.

        That may have been in the precise system, which rounds where the usual one only knows bounds.
        """
        of_lemmas = (r for lemma in lemmas for r in self._over_reals[lemma.name])
        return tuple(dict.fromkeys((*rounding, *of_lemmas)))

    def _exact(self, contract: Contract, *, at_once: bool = False) -> tuple[Proof, tuple[Reason, ...]] | None:
        """Return a proof in which rounding may do anything, and the places where rounding may still matter.

        `at_once`: only a proof in a frame alone.
        """
        budget = Budget(self._options, self._clock).part(_GENERAL)
        attempt = Attempt(self._general, contract.name, budget)
        proof = attempt.at_once() if at_once else attempt.run()
        if not isinstance(proof, Proof):
            return None
        self._general.proved(contract.name)
        return proof, _rounding([self._general.claims[contract.name], *attempt.lemmas])


def _rounding(claims: list[Claim]) -> tuple[Reason, ...]:
    """Return the places where reals stand in for floats in a contract, or in claims its proof may rest on."""
    reasons = dict.fromkeys(r for claim in claims for r in claim.inexact)
    return tuple(r for r in reasons if r.kind is Inexact.ROUNDING)
