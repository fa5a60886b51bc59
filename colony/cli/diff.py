"""`colony diff`: a proof that two behaviors are equivalent, or the shortest run in which they differ."""

from __future__ import annotations

import json
from pathlib import Path

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE, EXIT_UNDECIDED
from colony.cli.outputs import BEHAVIOR
from colony.cli.params_choice import params_option
from colony.cli.reporting import load_program, report
from colony.cli.robot_choice import description_option
from colony.cli.verify.prover_options import depth_option, timeout_option
from colony.cli.watch import page_options, watch_played
from colony.extras import expect_extras
from colony.ir.version import SEMANTICS
from colony.verify.interruption import reliable_interrupts


@click.command("diff", short_help="prove two behaviors equivalent, or show where they differ")
@click.argument("a", metavar="A.colony", type=BEHAVIOR)
@click.argument("b", metavar="B.colony", type=BEHAVIOR)
@description_option()
@params_option()
@click.option(
    "--ignore",
    multiple=True,
    metavar="NAME",
    help="Ignore an actuator, a field (drive.turn), or the frames in which a module wins. May be repeated.",
)
@click.option(
    "--actuator",
    "actuators",
    multiple=True,
    metavar="NAME_A=NAME_B",
    help="Compare these actuators of A and B, instead of those with the same name. May be repeated.",
)
@click.option(
    "--watch",
    "watches",
    is_flag=True,
    help="Show the run in the browser, once in A and once in B, as `colony watch` shows recordings, until "
    "Ctrl-C.",
)
@page_options
@depth_option("runs that differ")
@timeout_option(20.0)
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def command(
    a: str,
    b: str,
    ignore: tuple[str, ...],
    actuators: tuple[str, ...],
    watches: bool,
    port: int | None,
    opens: bool,
    depth: int,
    timeout: float,
    format_: str,
) -> None:
    """Prove that two behaviors send the same commands to every actuator, or show the shortest run in which
    they differ.

    The proof covers all possible sensor values, including missing ones, and any times between frames. Only
    the commands count: modules may have other names and another wiring. The output also shows which modules
    of A and B correspond.

    Exit code: 0 if the behaviors are equivalent, 1 if they differ, 2 if they cannot be compared (a file has
    errors, the robots differ, a name is unknown), 3 if the question could not be decided.

    \b
    Example:
      colony diff wander mine.colony
      colony diff --ignore drive.turn --ignore back_off old.colony new.colony
      colony diff --actuator left=right figure_4_14 figure_4_14
    """
    pairs = [_pair(text) for text in actuators]
    if (opens or port is not None) and not watches:
        raise click.UsageError("--open and --port require --watch", click.get_current_context())
    if watches and format_ != "text":
        raise click.UsageError("--watch requires --format text", click.get_current_context())
    program_a, program_b = load_program(a, EXIT_MISUSE), load_program(b, EXIT_MISUSE)
    expect_extras("verify", *(["watch"] if watches else []))
    from colony.text.diagnostics import DiagnosticError
    from colony.verify.contracts.results import ProofOptions
    from colony.verify.difference import DifferenceUndecided, Different, difference
    from colony.verify.difference.report import lines, row

    options = ProofOptions.within(timeout, depth=depth)
    try:
        with reliable_interrupts():
            result = difference(program_a, program_b, ignore, pairs, options)
    except DiagnosticError as failure:
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    if format_ == "json":
        compared = {"semantics": SEMANTICS, "a": a, "b": b, **row(program_a, program_b, result)}
        click.echo(json.dumps(compared, indent=2))
    else:
        click.echo("\n".join((f"A is {a}, B is {b}", *lines(program_a, program_b, result))))
    if watches and isinstance(result, Different):
        from colony.analysis.played import PlayedRun

        run_a = PlayedRun(program_a, result.snapshots)
        run_b = PlayedRun(program_b, result.snapshots_b)
        watch_played({f"A, {Path(a).name}": run_a, f"B, {Path(b).name}": run_b}, port=port, opens=opens)
    code = EXIT_ERRORS if isinstance(result, Different) else EXIT_UNDECIDED
    if isinstance(result, Different | DifferenceUndecided):
        raise click.exceptions.Exit(code)


def _pair(text: str) -> tuple[str, str]:
    name_a, equals, name_b = text.partition("=")
    if not (name_a and equals and name_b):
        message = f"`{text}` is not a pair of actuators; expected NAME_A=NAME_B"
        raise click.UsageError(message, click.get_current_context())
    return name_a, name_b
