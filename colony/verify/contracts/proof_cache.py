"""Verdicts of contracts on disk, by content: of a program, the prover and its options.

The cache saves time and decides nothing else: what cannot be read there is proved again, and what cannot be
written there is not kept.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from hashlib import sha256
from importlib import metadata
from pathlib import Path

from colony.compile.pipeline import compile_program
from colony.execute.colonyc import encode
from colony.files import keep_in_cache, read_from_cache, user_cache
from colony.ir.program import Program
from colony.ir.version import SEMANTICS
from colony.verify.contracts.results import Options

PROVER = 3
"""Version of the prover: increment it if it may now refute, or not prove, a contract that it proved."""

MAX_BYTES = 4 * 1024 * 1024
"""Byte limit of the verdicts of one program."""


def cache_folder(environment: Mapping[str, str]) -> Path | None:
    """Return the folder of verdicts in the user's cache, None if there is no such cache."""
    return user_cache(environment, "proofs")


def content_key(program: Program, options: Options) -> str:
    """Return a text that differs if anything differs on which the verdicts of a program's contracts depend.

    Comments and layout count, too, because compiled programs have places; values that nothing reads do not.
    """
    compiled = replace(compile_program(program).compiled, sources=(), root="", site=None)
    try:
        solver = metadata.version("z3-solver")
    except metadata.PackageNotFoundError:
        solver = ""
    about = json.dumps([PROVER, SEMANTICS, solver, repr(options)])
    return sha256(about.encode() + b"\0" + encode(compiled)).hexdigest()


class ProofCache:
    """Verdicts in a folder, which may be missing, damaged or read-only; None for no cache."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

    def verdicts(self, key: str) -> dict[str, str]:
        """Return the verdicts, as JSON has them, by contract; none if there are none that can be read."""
        if self._folder is None:
            return {}
        try:
            found = json.loads(read_from_cache(self._folder / f"{key}.json", MAX_BYTES))
        except (OSError, ValueError, RecursionError):
            return {}
        if not isinstance(found, dict) or not all(isinstance(v, str) for v in found.values()):
            return {}
        return found

    def keep(self, key: str, verdicts: Mapping[str, str]) -> None:
        """Write verdicts, whole or not at all."""
        if self._folder is None:
            return
        with suppress(OSError):
            keep_in_cache(self._folder / f"{key}.json", json.dumps(dict(verdicts)).encode())
