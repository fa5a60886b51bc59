"""`colony diff`: a proof that two behaviors are the same, or a shortest run in which they differ."""

from __future__ import annotations

import json
import time

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE, EXIT_UNDECIDED
from colony.cli.reporting import load_program, report
from colony.cli.shipped_files import BEHAVIOR
from colony.cli.verify.prover_options import depth_option, timeout_option
from colony.extras import expect_extras
from colony.verify.interruption import interruptions


@click.command("diff", short_help="tell whether two behaviors are the same")
@click.argument("a", metavar="A.colony", type=BEHAVIOR)
@click.argument("b", metavar="B.colony", type=BEHAVIOR)
@click.option(
    "--ignore",
    multiple=True,
    metavar="NAME",
    help="An actuator, a field (drive.turn), or a module: frames in which it wins. May be repeated.",
)
@click.option(
    "--actuator",
    "actuators",
    multiple=True,
    metavar="NAME=NAME",
    help="Compare this actuator of A with that one of B, instead of those of one name. May be repeated.",
)
@depth_option("runs that differ")
@timeout_option(20.0)
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def command(
    a: str,
    b: str,
    ignore: tuple[str, ...],
    actuators: tuple[str, ...],
    depth: int,
    timeout: float,
    format_: str,
) -> None:
    """Prove that two behaviors send the same to every actuator, or show the shortest run in which they don't.

    All that sensors can give is considered, missing sensors and any times between frames included. What
    counts is what is sent: modules may have other names and be wired otherwise. Told as well is which modules
    of A are which of B.

    Exit code 0 where they are the same, 1 where they differ, 2 where they cannot be compared (a file has
    errors, the robots differ, a name is unknown), 3 where it could not be decided.

    \b
    Example:
      colony diff wander mine.colony
      colony diff --ignore drive.turn --ignore back_off old.colony new.colony
      colony diff --actuator left=right figure_4_14 figure_4_14
    """
    pairs = [_pair(text) for text in actuators]
    one, other = load_program(a, EXIT_MISUSE), load_program(b, EXIT_MISUSE)
    expect_extras("verify")
    from colony.text.diagnostics import DiagnosticError
    from colony.verify.contracts.results import Options
    from colony.verify.difference import Different, Undecided, difference
    from colony.verify.difference.report import lines, row

    options = Options.within(timeout, depth=depth)
    try:
        with interruptions():
            result = difference(one, other, ignore, pairs, options, time.monotonic)
    except DiagnosticError as failure:
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    if format_ == "json":
        click.echo(json.dumps({"a": a, "b": b, **row(one, other, result)}, indent=2))
    else:
        click.echo("\n".join((f"A is {a}, B is {b}", *lines(one, other, result))))
    code = EXIT_ERRORS if isinstance(result, Different) else EXIT_UNDECIDED
    if isinstance(result, Different | Undecided):
        raise click.exceptions.Exit(code)


def _pair(text: str) -> tuple[str, str]:
    mine, equals, its = text.partition("=")
    if not (mine and equals and its):
        message = f"`{text}` is no pair of actuators: write the name in A, `=`, and the name in B"
        raise click.UsageError(message, click.get_current_context())
    return mine, its
