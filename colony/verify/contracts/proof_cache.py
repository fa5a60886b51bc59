"""What was found about a program on disk, by content: of the program, the prover and its options.

A proof is kept for the declarations that its contract depends on, wherever they stand; all else, which names
places or has runs, for the whole text. The cache saves time and decides nothing: what cannot be read there is
proved again, and what cannot be written there is not kept.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache, cached_property
from hashlib import sha256
from importlib import metadata
from pathlib import Path
from typing import TypeVar

from colony import verify
from colony.files import keep_in_cache, read_from_cache, user_cache
from colony.ir.expression import Constant
from colony.ir.program import Contract, Program
from colony.ir.types import BOOL
from colony.ir.version import SEMANTICS
from colony.verify.contracts.results import (
    Options,
    OverReals,
    Proved,
    ProvedInTime,
    Refuted,
    Result,
    Unknown,
)
from colony.verify.contracts.slicing import needs_of_slices

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

    def __init__(self, folder: Path | None, program: Program, options: Options, names: Iterable[str]) -> None:
        self._folder = folder
        self._program = program
        self._about = repr((_prover(), SEMANTICS, options))
        self._names = sorted(names)

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
