"""`colony verify`: contracts proved or refuted, and modules that can never act."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.reporting import Format, format_option, is_unreadable
from colony.cli.shipped_files import BEHAVIOR
from colony.cli.verify.output import close, show
from colony.cli.verify.progress import progress
from colony.cli.verify.prover_options import depth_option, timeout_option
from colony.cli.verify.tests import check_writable
from colony.cli.verify.work import Verified, Work, load
from colony.extras import expect_extras
from colony.text.suggestions import did_you_mean
from colony.verify.interruption import interruptions


@click.command("verify", short_help="prove contracts, find what can never act")
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=BEHAVIOR)
@click.option(
    "--contract", "names", multiple=True, metavar="NAME", help="Only this contract; may be repeated."
)
@depth_option("counterexamples")
@timeout_option(10.0, each="contract")
@click.option("--write-test", is_flag=True, help="Append each counterexample to its FILE as a test.")
@click.option(
    "--examples", type=click.IntRange(min=0), default=0, metavar="N", help="Try N drawn traces as well."
)
@click.option("--seed", type=int, default=0, show_default=True, help="What traces are drawn from.")
@click.option("--faults", is_flag=True, help="Try the drawn traces with servers and clients that fail, too.")
@format_option
def command(
    files: tuple[str, ...],
    names: tuple[str, ...],
    depth: int,
    timeout: float,
    write_test: bool,
    examples: int,
    seed: int,
    faults: bool,
    format_: str,
) -> None:
    """Prove each contract for all that sensors can give, or find the shortest run that breaks it.

    A contract is proved (for every run of any length), REFUTED by a run that is shown, or unknown, and why.
    Then follow modules that can never act and other oddities, as warnings. Modules in Python may answer
    anything.

    Exit code 0 where nothing is refuted (warnings included), 1 where something is or a file has errors, 2
    where a file cannot be read.

    \b
    Example:
      colony verify wander
      colony verify --contract never_rams --depth 8 wander
      colony verify --write-test patrol.colony
      colony verify --examples 1000 --seed 7 behaviors/*.colony
    """
    context = click.get_current_context()
    if faults and not examples:
        raise click.UsageError("--faults goes with --examples N", context)
    expect_extras("verify")
    files_ = [load(file, write_test=write_test) for file in dict.fromkeys(files)]
    _check_names(names, files_, context)
    for one in files_:
        if write_test and one.program is not None:
            check_writable(one.file)
    work = Work(
        names=names,
        depth=depth,
        timeout=timeout,
        examples=examples,
        seed=seed,
        faults=faults,
    )
    done: list[Verified] = []
    try:
        for one in files_:
            done.append(one)
            with progress() as tell, interruptions():
                work.on(one, tell)
            if format_ == "text":
                show(one)
    except KeyboardInterrupt:
        if format_ == "text":
            show(done[-1])
        close(done, cast(Format, format_), interrupted=True)
        raise
    close(done, cast(Format, format_))
    raise click.exceptions.Exit(_exit_code(done))


def _check_names(names: Sequence[str], files: Sequence[Verified], context: click.Context) -> None:
    """Refuse the name of an unknown contract, unless a file has errors, which may explain it."""
    if any(one.program is None for one in files):
        return
    known = {c.name for one in files if one.program for c in one.program.contracts}
    for name in names:
        if name not in known:
            hint = did_you_mean(name, known) or f"the contracts are: {', '.join(sorted(known)) or 'none'}"
            raise click.UsageError(f"no contract `{name}`; {hint}", context)


def _exit_code(done: Sequence[Verified]) -> int:
    from colony.text.diagnostics import has_errors

    if any(is_unreadable(one.found) for one in done):
        return EXIT_MISUSE
    return EXIT_ERRORS if any(has_errors(one.found) or one.bug for one in done) else 0
