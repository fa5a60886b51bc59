"""Contracts that are proved of a program, and stay proved with the params of a site or not.

A contract that is proved with the program's own values has to be proved with those of the site, too. One that
was proved although clients may be late must not be proved only while all are in time.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property
from hashlib import sha256
from importlib import metadata
from pathlib import Path
from typing import TypeVar

from colony import verify
from colony.files import keep_in_cache, read_from_cache, user_cache
from colony.ir.expression import Constant
from colony.ir.program import Contract, Program, assumptions, without_assumed
from colony.ir.types import BOOL
from colony.ir.version import SEMANTICS
from colony.verify.contracts.concrete_runs import Replay
from colony.verify.contracts.report import verdict_key
from colony.verify.contracts.results import (
    OverReals,
    ProofOptions,
    Proved,
    ProvedInTime,
    Refuted,
    Result,
    Trace,
    Unknown,
    trace_of,
)
from colony.verify.contracts.slicing import needs_of_slices

# --- proof cache ---------------------------------------------------------------------------------------
#
# What was found about a program on disk, by content: of the program, the prover and its options.
#
# A proof is kept for the declarations that its contract depends on, wherever they stand; all else, which
# names places or has runs, for the whole text. The cache saves time and decides nothing: what cannot be
# read there is proved again, and what cannot be written there is not kept.


Kept = TypeVar("Kept")

MAX_BYTES = 16 * 1024 * 1024
"""Byte limit of a file."""

_MAX_FILES = 4096
"""Number of files above which the oldest are deleted."""

_SEAL_BYTES = sha256().digest_size

_NO_CONTRACT = Contract(name="", expression=Constant(type=BOOL, value=True))


def cache_folder(environment: Mapping[str, str]) -> Path | None:
    """Return the folder of proofs in the user's cache, None if there is no such cache."""
    return user_cache(environment, "proofs")


class ProofCache:
    """What is known about a program if the contracts `names` are proved together.

    `folder` may be missing, damaged or read-only; None for no cache.
    """

    def __init__(
        self, folder: Path | None, program: Program, options: ProofOptions, names: Iterable[str]
    ) -> None:
        self._folder = folder
        self._program = program
        self._options = options
        self._about = repr((_prover(), SEMANTICS, options))
        self._names = sorted(names)

    def about(self, program: Program, names: Iterable[str]) -> ProofCache:
        """Return what is known about another program in the same folder."""
        return ProofCache(self._folder, program, self._options, names)

    @cached_property
    def _whole(self) -> str:
        """The whole program with its texts, and what is to be proved."""
        texts = [(name, source.text) for name, source in self._program.files]
        return _digest((self._about, repr(self._program), repr(texts), repr(self._names)))

    @cached_property
    def _slices(self) -> dict[str, str]:
        """By contract, what it and the contracts that may help to prove it depend on."""
        program = self._program
        values = {d.name: _digest([repr(d)]) for d in (*program.robot.sensors, *program.derived)}
        modules = {m.name: _digest([repr(m)]) for m in program.modules}
        rest = _digest([repr(replace(program.robot, sensors=())), repr(program.wires), repr(program.limits)])
        contracts = [(c.name, _digest([repr(c)])) for c in program.contracts]
        needs = needs_of_slices(program)
        return {
            contract.name: _digest(
                [
                    self._about,
                    rest,
                    *(values[name] for name in sorted(needs[contract.name].values)),
                    *(modules[name] for name in sorted(needs[contract.name].parts) if name in modules),
                    *(digest for name, digest in contracts if needs[contract.name].covers(needs[name])),
                    contract.name,
                ]
            )
            for contract in program.contracts
        }

    def result(self, contract: Contract) -> Result | None:
        """Return the result of a contract, None if it is not known."""
        for key in (self._slices[contract.name], f"{self._whole}-{contract.name}"):
            found = self._read(key)
            if isinstance(found, Result):
                return _about(found, contract)
        return None

    def known(self, contracts: Iterable[Contract]) -> dict[str, Result]:
        """Return the results that are known, by contract."""
        return {c.name: result for c in contracts if (result := self.result(c)) is not None}

    def keep(self, result: Result) -> None:
        """Keep the result of a contract."""
        name = result.contract.name
        key = self._slices[name] if _is_final(result) else f"{self._whole}-{name}"
        self._write(key, _about(result, _NO_CONTRACT))

    def found(self, what: str, kind: type[Kept]) -> Kept | None:
        """Return what is known about the whole text under a name, None if there is nothing of this kind."""
        found = self._read(f"{self._whole}-{what}")
        return found if isinstance(found, kind) else None

    def keep_found(self, what: str, value: object) -> None:
        """Keep what was found about the whole text."""
        self._write(f"{self._whole}-{what}", value)
        if self._folder is not None:
            _prune(self._folder)

    def _read(self, key: str) -> object:
        if self._folder is None:
            return None
        try:
            kept = read_from_cache(self._folder / f"{_digest([key])}.pickle", MAX_BYTES)
            seal, data = kept[:_SEAL_BYTES], kept[_SEAL_BYTES:]
            return pickle.loads(data) if seal == _seal(key, data) else None
        except Exception:  # whatever another version of a class makes of it
            return None

    def _write(self, key: str, value: object) -> None:
        if self._folder is None:
            return
        with suppress(OSError):
            data = pickle.dumps(value)
            keep_in_cache(self._folder / f"{_digest([key])}.pickle", _seal(key, data) + data)


def _is_final(result: Result) -> bool:
    """Return True for a proof to which no other declarations could add anything."""
    return (
        isinstance(result, Proved) and not result.over_reals and (result.operators or result.contract.in_time)
    )


def _about(result: Result, contract: Contract) -> Result:
    """Return a result as one about `contract`, which differs in places alone."""
    match result:
        case Proved() | Refuted() | Unknown():
            return replace(result, contract=contract)
        case ProvedInTime(in_time=in_time):
            return replace(result, contract=contract, in_time=replace(in_time, contract=contract))
        case OverReals(proof=proof):
            about = _about(proof, contract)
            assert isinstance(about, Proved | ProvedInTime)
            return replace(result, contract=contract, proof=about)


def _seal(key: str, data: bytes) -> bytes:
    """Return what stands before `data` in the file of a key: one flipped bit may be another verdict."""
    return sha256(key.encode() + data).digest()


def _digest(texts: Iterable[str]) -> str:
    digest = sha256()
    for text in texts:
        digest.update(sha256(text.encode("utf-8", "surrogatepass")).digest())
    return digest.hexdigest()


@cache
def _prover() -> str:
    """Return a text that differs if the prover does."""
    try:
        solver = metadata.version("z3-solver")
    except metadata.PackageNotFoundError:
        solver = ""
    folder = Path(verify.__file__).parent
    files = [(str(f.relative_to(folder)), f.stat()) for f in sorted(folder.rglob("*.py"))]
    return repr((solver, [(name, status.st_size, status.st_mtime_ns) for name, status in files]))


def _prune(folder: Path) -> None:
    """Delete the older half of the files if there are too many."""
    with suppress(OSError):
        files = list(folder.glob("*.pickle"))
        if len(files) > _MAX_FILES:
            for file in sorted(files, key=lambda f: f.stat().st_mtime)[: len(files) // 2]:
                file.unlink()


# --- kept ----------------------------------------------------------------------------------------------


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
    options: ProofOptions,
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
    options: ProofOptions
    on_progress: OnProgress

    def verdicts(self, program: Program, names: Sequence[str]) -> dict[str, str]:
        """Return the verdicts of contracts."""
        own_names = {c.name for c in program.contracts}
        found = self.prove(program, [name for name in names if name in own_names])
        return {name: verdict_key(result) for name, result in found.items()}

    def prove(self, program: Program, names: Sequence[str]) -> dict[str, Result]:
        """Return the results of contracts; the prover is loaded only if one is not known.

        A result without assumptions may not be the last word, if the program has any.
        """
        program = program if assumptions(program) else without_assumed(program)
        cache = ProofCache(self.folder, program, self.options, names)
        asked = [c for c in program.contracts if c.name in names]
        known = {} if assumptions(program) else cache.known(asked)
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
