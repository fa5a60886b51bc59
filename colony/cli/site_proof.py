"""Params of a site, proved: what is proved of a program must be proved with them, too."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NoReturn

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.progress import proof_progress
from colony.cli.reporting import report, say
from colony.cli.robot_choice import chosen_robot
from colony.cli.verify.prover_options import DEFAULT_DEPTH, DEFAULT_SECONDS
from colony.extras import install_command, installed
from colony.text.wording import counted, quoted
from colony.verify.interruption import reliable_interrupts

if TYPE_CHECKING:
    from colony.compile.pipeline import Compilation
    from colony.dsl.site import SiteParams, SiteValue
    from colony.execute.compiled import Compiled
    from colony.ir.program import Program
    from colony.text.diagnostics import Diagnostic
    from colony.verify.contracts.kept import KeptProofs, LostProof


def with_proof(compilation: Compilation, file: str, params: SiteParams, *, instead: str) -> Compiled:
    """Return the compiled program with the contracts that stay proved with the params of a site.

    Exits with 1 if one does not stay proved, with 2 if that cannot be proved here. `instead` is the option
    that does without the proof.
    """
    compiled, program = compilation.compiled, compilation.program
    assert compiled.site is not None
    count = sum(not c.assumed for c in program.contracts)
    if not count:
        return replace(compiled, site=compiled.site.with_proof(()))
    if not installed("z3"):
        say(
            f"{params.file}: error: {counted(count, 'contract')} must be proved with these "
            f"params, and z3 is not installed; {install_command('verify')}, run a .colonyc that was compiled "
            f"with them, or give {instead}"
        )
        raise click.exceptions.Exit(EXIT_MISUSE)
    kept = _kept_proofs(program, file, params)
    if kept.lost:
        _refuse(program, file, params, kept.lost, instead)
    return replace(compiled, site=compiled.site.with_proof(kept.proved))


def _kept_proofs(program: Program, file: str, params: SiteParams) -> KeptProofs:
    from colony.verify.contracts.kept import cache_folder, kept_proofs
    from colony.verify.contracts.results import ProofOptions

    has_said = False
    with proof_progress() as (on_progress, _), reliable_interrupts():

        def show(completed: int, total: int, current: str) -> None:
            nonlocal has_said
            if not has_said:
                say(f"proving contracts with the params of {params.file}")
                has_said = True
            on_progress(completed, total, current)

        return kept_proofs(
            _program_with(file, None),
            program,
            folder=cache_folder(os.environ),
            options=ProofOptions.within(DEFAULT_SECONDS, depth=DEFAULT_DEPTH),
            on_progress=show,
        )


def _program_with(file: str, params: SiteParams | None) -> Program | None:
    """Return the program with these params alone, None if it has errors."""
    from colony.dsl.load import check_file

    return check_file(file, robot=chosen_robot(), params=params).program


def _refuse(
    program: Program, file: str, params: SiteParams, lost: Sequence[LostProof], instead: str
) -> NoReturn:
    """Report each contract that does not stay proved, with the run that breaks it, and exit."""
    from colony.verify.contracts.kept import blamed
    from colony.verify.contracts.report import lines

    names = [value.name for value in params.values]
    for proof in lost:
        guilty = blamed(
            proof.result, names, lambda kept: _program_with(file, params.only(kept) if kept else None)
        )
        report([_diagnostic(proof, [value for value in params.values if value.name in guilty], instead)])
        head, *below = lines(program, proof.result)
        say(f"{file}: {head}")
        for line in below:
            say(f"  {line}")
    raise click.exceptions.Exit(EXIT_ERRORS)


def _diagnostic(proof: LostProof, values: Sequence[SiteValue], instead: str) -> Diagnostic:
    from colony.text.diagnostics import Diagnostic, Label
    from colony.verify.contracts.report import finding

    contract, first = proof.result.contract, values[0]
    broken = finding(proof.result, None)
    assert broken is not None
    found = broken.message.removeprefix(f"contract `{contract.name}` ")
    how = "is not proved" if not proof.before else "is not proved any more"
    with_values = quoted([f"{value.name} = {value.text}" for value in values[:3]])
    more = f" and {len(values) - 3} more" if len(values) > 3 else ""
    labels = [Label(value.place, "and this value") for value in values[1:3]]
    own = (
        "the contract" if not proof.before else "the contract, which is proved with the program's own values"
    )
    return Diagnostic(
        code="V013",
        span=first.place,
        message=f"with {with_values}{more}, contract `{contract.name}` {how}: it {found}",
        hint=f"change the value, or do without the proof: {instead}",
        labels=(*labels, Label(contract.span, own)),
    )
