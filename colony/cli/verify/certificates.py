"""Certificates of proofs, written by `colony verify --certificate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from colony.cli.outputs import cannot_write, write_whole
from colony.cli.reporting import say
from colony.files import reason

if TYPE_CHECKING:
    from colony.verify.contracts.prove import Prover
    from colony.verify.contracts.results import Options, Result


def make_folder(folder: Path) -> None:
    """Make the folder of certificates before the work begins; exit with 2 if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        cannot_write(folder, reason(problem))


def write_certificate(folder: Path, options: Options, prover: Prover, result: Result) -> None:
    """Write the certificate of a contract that `prover` has proved, or remove that of an earlier version."""
    from colony.verify.contracts.certificate import certificate
    from colony.verify.contracts.results import OverReals, Proved, ProvedInTime

    path = folder / f"{result.contract.name}.smt2"
    if isinstance(result, Proved | ProvedInTime):
        text = certificate(prover, result, options)
        if text is not None:
            write_whole(path, text)
            return
        say(f"{path}: no certificate: z3 gave up; raise --timeout")
    elif isinstance(result, OverReals):
        say(f"{path}: no certificate: {result.contract.name} is proved only over real numbers")
    try:
        path.unlink(missing_ok=True)
    except OSError as problem:
        cannot_write(path, reason(problem))
