"""Contracts that are proved of a program, and stay proved with the params of a site or not.

A contract that is proved with the program's own values has to be proved with those of the site, too. One that
was proved although clients may be late must not be proved only while all are in time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from colony.ir.program import Program, without_assumed
from colony.verify.contracts.proof_cache import ProofCache
from colony.verify.contracts.replay import Replay
from colony.verify.contracts.report import verdict_key
from colony.verify.contracts.results import Options, Result, Trace, trace_of

_RANKS: Mapping[str, int] = {"proved": 3, "proved_in_time": 2, "over_reals": 1}

OnProgress = Callable[[int, int, str], None]
"""A function that reports progress: the number of finished contracts, the total, and the present one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LostProof:
    """A contract that is proved of a program with its own values, and not with those of a site.

    Attributes:
        before: the verdict with the program's own values, as JSON has it; "" if these cannot be checked.
        result: the result with those of the site.
    """

    before: str
    result: Result


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptProofs:
    """The contracts that stay proved, by name in the order written, and those that do not."""

    proved: tuple[str, ...]
    lost: tuple[LostProof, ...]


def kept_proofs(
    own: Program | None,
    program: Program,
    *,
    folder: Path | None,
    options: Options,
    on_progress: OnProgress,
) -> KeptProofs:
    """Return which contracts stay proved with the params of a site.

    Args:
        own: the program with its own values; None if it has errors with them. Every contract has then to be
            proved.
        program: the program with the values of the site.
        folder: the cache of proofs, if there is one.
        options: the effort for each contract.
        on_progress: a function that is called before each contract; not if the cache has all verdicts.
    """
    names = [c.name for c in without_assumed(program).contracts]
    prover = _Prover(folder, options, on_progress)
    before = dict.fromkeys(names, "proved_in_time") if own is None else prover.verdicts(own, names)
    needed = [name for name in names if name in before and before[name] in _RANKS]
    found = prover.prove(program, needed)

    def stays(name: str, verdict: str) -> bool:
        return _RANKS.get(verdict, 0) >= _RANKS[before[name]]

    lost = [
        LostProof(before="" if own is None else before[name], result=found[name])
        for name in needed
        if not stays(name, verdict_key(found[name]))
    ]
    lost_names = {proof.result.contract.name for proof in lost}
    return KeptProofs(proved=tuple(name for name in needed if name not in lost_names), lost=tuple(lost))


@dataclass(frozen=True, slots=True)
class _Prover:
    folder: Path | None
    options: Options
    on_progress: OnProgress

    def verdicts(self, program: Program, names: Sequence[str]) -> dict[str, str]:
        """Return the verdicts of contracts."""
        own_names = {c.name for c in program.contracts}
        found = self.prove(program, [name for name in names if name in own_names])
        return {name: verdict_key(result) for name, result in found.items()}

    def prove(self, program: Program, names: Sequence[str]) -> dict[str, Result]:
        """Return the results of contracts; the prover is loaded only if one is not known."""
        program = without_assumed(program)
        cache = ProofCache(self.folder, program, self.options, names)
        asked = [c for c in program.contracts if c.name in names]
        known = cache.known(asked)
        return known if len(known) == len(asked) else dict(self._proved(program, list(names), cache))

    def _proved(self, program: Program, names: list[str], cache: ProofCache) -> Iterator[tuple[str, Result]]:
        from colony.verify.contracts.prove import results

        self.on_progress(0, len(names), "")
        for count, result in enumerate(results(program, names, self.options, cache=cache), 1):
            self.on_progress(count, len(names), result.contract.name)
            yield result.contract.name, result


def blamed(
    result: Result, names: Sequence[str], program_with: Callable[[frozenset[str]], Program | None]
) -> frozenset[str]:
    """Return the values that break a contract: without any one of them, the run that breaks it does not.

    All values are returned if no run is known.

    Args:
        result: the result for the contract with all values.
        names: the names of the values.
        program_with: a function that returns the program with these values alone, None if it has errors.
    """
    trace, kept = trace_of(result), frozenset(names)
    for name in names if trace is not None else ():
        program = program_with(kept - {name})
        if program is not None and trace is not None and _breaks(program, result.contract.name, trace):
            kept -= {name}
    return kept or frozenset(names)


def _breaks(program: Program, contract: str, trace: Trace) -> bool:
    return Replay(program, contract).breaks(trace.snapshots)
