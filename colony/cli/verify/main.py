"""`colony verify`: contracts proved or refuted, and modules that can never act."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, cast

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.outputs import BEHAVIOR
from colony.cli.params_choice import params_option
from colony.cli.progress import proof_progress
from colony.cli.reporting import Format, format_option, is_unreadable, say
from colony.cli.robot_choice import description_option
from colony.cli.verify.output import finish_output, show_rest, show_result
from colony.cli.verify.prover_options import COUNTED, DEFAULT_SECONDS, ProverSeconds, depth_option
from colony.cli.verify.work import Verified, Work, check_writable, load, make_folder
from colony.cli.watch import page_options, watch_played
from colony.extras import expect_extras
from colony.text.wording import did_you_mean
from colony.verify.interruption import reliable_interrupts

if TYPE_CHECKING:
    from colony.ir.program import Contract


@click.command("verify", short_help="prove contracts, and find modules that can never act")
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=BEHAVIOR)
@description_option()
@params_option()
@click.option(
    "--contract",
    "names",
    multiple=True,
    metavar="NAME",
    help="Verify only this contract or reach. May be repeated.",
)
@click.option(
    "--why",
    multiple=True,
    metavar="NAME",
    help="Verify only this contract, and if it is proved without operators, search for a run in which a "
    "command from outside the network breaks it. May be repeated.",
)
@click.option(
    "--watch",
    "watched",
    metavar="NAME",
    help="Verify only this contract, and show the run that breaks it in the browser, as `colony watch` shows "
    "recordings, until Ctrl-C. With `--why NAME`, the run with a command from outside. Only with one FILE.",
)
@page_options
@depth_option("counterexamples")
@click.option(
    "--timeout",
    type=ProverSeconds(),
    metavar="SECONDS",
    help=f"The approximate time limit for each FILE, shared by what is to be decided. {COUNTED} Without it, "
    f"each attempt at a contract (a difficult one takes several) has {DEFAULT_SECONDS:g} s.",
)
@click.option(
    "--write-test",
    is_flag=True,
    help="Append each run that refutes a contract, or gets to a reach, to its FILE as a test.",
)
@click.option(
    "--certificate",
    "certificates",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Write the proof of each contract that is proved (not over reals) to DIR/NAME.smt2, which z3 and "
    "cvc5 check without colony. Only with one FILE.",
)
@click.option(
    "--examples",
    type=click.IntRange(min=0),
    default=0,
    metavar="N",
    help="Also run N random traces through all executors.",
)
@click.option("--seed", type=int, default=0, show_default=True, help="The seed of the random traces.")
@click.option(
    "--faults", is_flag=True, help="With --examples: also run the traces with failing servers and clients."
)
@click.option(
    "--margin",
    is_flag=True,
    help="Also find how wrong, how late and how rare the readings of each sensor may be before a contract "
    "that is proved falls.",
)
@click.option(
    "--report",
    "report_folder",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Write requirements, verdicts, tests and hashes of inputs to DIR, as index.html and report.json; "
    "exit with 1 unless each requirement is met.",
)
@click.option(
    "--requirements",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="TABLE",
    help='With --report: the texts of the requirements, TOML ("SR-12" = "text") or CSV (id,text).',
)
@click.option(
    "--strict",
    is_flag=True,
    help="Fail also if a contract is unknown or only over reals, or a question was not decided.",
)
@format_option
def command(
    files: tuple[str, ...],
    names: tuple[str, ...],
    why: tuple[str, ...],
    watched: str | None,
    port: int | None,
    opens: bool,
    depth: int,
    timeout: float | None,
    write_test: bool,
    certificates: Path | None,
    examples: int,
    seed: int,
    faults: bool,
    margin: bool,
    report_folder: Path | None,
    requirements: Path | None,
    strict: bool,
    format_: str,
) -> None:
    """Prove each contract for all possible sensor values, or find the shortest run that breaks it.

    A contract is proved (for every run of any length, clients late or lost included), proved in time (only
    while every client is in time; V012 is a note about the other runs), over reals (proved where no float
    rounds, and no run was found that breaks it), REFUTED by a run, which is shown, or unknown for a stated
    reason. "(operators too)": also proved while a joystick or a script commands within the limits; "(without
    operators)": a command may break the contract, as --why shows, or no proof was found; "(assuming A)": the
    proof rests on `assume A`. A `reach` is reached by the run that is shown, NEVER REACHED if it is proved
    that no run gets there, over reals or unknown.
    Warnings about modules that can never act, and about other likely mistakes, follow. The proofs allow
    modules in Python any answer.

    Exit code: 0 if nothing is refuted (warnings and notes are allowed), 1 if a contract is refuted or a reach
    never reached (with --strict also if one is unknown or over reals), a file has errors, an index that
    decides may be outside its array, no run meets the assumptions, or limits contradict each other on
    `idle hold`, 2 if a file cannot be read.

    \b
    Example:
      colony verify wander
      colony verify --contract never_rams --depth 8 wander
      colony verify --why bump_first hallway
      colony verify --write-test patrol.colony
      colony verify --certificate proofs wander && z3 proofs/never_rams.smt2
      colony verify --margin --contract slow_near careful.colony
      colony verify --examples 1000 --seed 7 behaviors/*.colony
    """
    context = click.get_current_context()
    is_one, watches = len(dict.fromkeys(files)) == 1, watched is not None
    for is_wrong, message in (
        (faults and not examples, "--faults requires --examples N"),
        (certificates and not is_one, "--certificate requires a single FILE"),
        (watches and not is_one, "--watch requires a single FILE"),
        (watches and format_ != "text", "--watch requires --format text"),
        ((opens or port is not None) and not watches, "--open and --port require --watch NAME"),
        (
            report_folder and (names or why or watches),
            "--report is about all contracts: leave out --contract, --why and --watch",
        ),
        (requirements and not report_folder, "--requirements requires --report DIR"),
    ):
        if is_wrong:
            raise click.UsageError(message, context)
    expect_extras("verify", *(["watch"] if watches else []))
    write_report = None if report_folder is None else _report_writer(report_folder, requirements)
    names += why if watched is None else (*why, watched)
    loaded = [load(file, write_test=write_test) for file in dict.fromkeys(files)]
    _check_names(names, loaded, context)
    for verified in loaded:
        if write_test and verified.program is not None:
            check_writable(verified.file)
    for folder in (certificates, report_folder):
        if folder is not None:
            make_folder(folder)
    work = Work(
        names=names,
        why=why,
        depth=depth,
        timeout=timeout,
        certificates=certificates,
        examples=examples,
        seed=seed,
        faults=faults,
        margin=margin,
    )
    begun: list[Verified] = []
    try:
        for verified in loaded:
            begun.append(verified)
            with proof_progress() as (on_progress, pause), reliable_interrupts():
                for result in work.run(verified, on_progress):
                    if format_ == "text":
                        with pause():
                            show_result(verified, result)
            if format_ == "text":
                show_rest(verified)
    except KeyboardInterrupt:
        if format_ == "text":
            show_rest(begun[-1])
        finish_output(begun, cast(Format, format_), interrupted=True)
        raise
    finish_output(begun, cast(Format, format_))
    code = _exit_code(begun, strict)
    if write_report is not None and all(verified.program for verified in begun):
        is_met = write_report(begun, on_stderr=format_ != "text")
        code = code or (0 if is_met else EXIT_ERRORS)
    _watch(loaded[0], watched, port=port, opens=opens)
    raise click.exceptions.Exit(code)


def _report_writer(folder: Path, table: Path | None) -> Callable[..., bool]:
    """Return the function that writes the report; a table of requirements is read before the work begins."""
    from colony.cli.verify.requirement_report import requirements_table, write_report

    return partial(write_report, folder, requirements_table(table))


def _watch(verified: Verified, name: str | None, *, port: int | None, opens: bool) -> None:
    """Show the run that breaks a contract, or gets to a reach, until the command is interrupted."""
    from colony.analysis.played import PlayedRun
    from colony.verify.contracts.results import Proved, trace_of

    result = next((r for r in verified.results if r.contract.name == name), None)
    if result is None or verified.checked is None:
        return
    runs = result.operator_runs or () if isinstance(result, Proved) else ()
    trace = next(iter(runs), trace_of(result))
    if trace is None:
        say(f"{verified.file}: no run to watch: none is known that {_end(result.contract)}")
        return
    reached = tuple(c for c in verified.checked.reaches if c.name == name)
    program = replace(verified.checked, contracts=(*verified.checked.contracts, *reached))
    run = PlayedRun(program, trace.snapshots)
    if name not in (run.recorded[-1].breaches or ()):
        say(
            f"{verified.file}: the run shown ends just before it {_end(result.contract)}: no value in the "
            "declared units is one of its readings"
        )
    watch_played({f"{Path(verified.file).name}: {_end(result.contract)}": run}, port=port, opens=opens)


def _end(contract: Contract) -> str:
    return f"{'gets to' if contract.reach else 'breaks'} `{contract.name}`"


def _check_names(names: Sequence[str], files: Sequence[Verified], context: click.Context) -> None:
    """Refuse the name of an unknown contract, unless a file has errors: it may declare the contract."""
    if any(verified.program is None for verified in files):
        return
    programs = [verified.program for verified in files if verified.program]
    contract_names = {c.name for program in programs for c in (*program.contracts, *program.reaches)}
    for name in names:
        if name not in contract_names:
            names_text = ", ".join(sorted(contract_names)) or "none"
            hint = did_you_mean(name, contract_names) or f"the contracts are: {names_text}"
            raise click.UsageError(f"no contract `{name}`; {hint}", context)


def _exit_code(verified_files: Sequence[Verified], strict: bool) -> int:
    from colony.text.diagnostics import has_errors

    if any(is_unreadable(verified.diagnostics) for verified in verified_files):
        return EXIT_MISUSE
    failed = any(has_errors(verified.diagnostics) or verified.bug for verified in verified_files)
    failed = failed or (strict and any(verified.is_undecided for verified in verified_files))
    return EXIT_ERRORS if failed else 0
