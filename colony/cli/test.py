"""`colony test`: the tests that behavior files contain, in the reference interpreter."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout

import click

from colony.cli.exit_codes import EXIT_ERRORS
from colony.cli.reporting import load_program, report


@click.command("test", short_help="run the tests that behavior files contain")
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def command(files: tuple[str, ...], format_: str) -> None:
    """Run every `test` block; contracts are checked in each of its frames.

    Exit code 0 where all pass, 1 where one fails or a file has errors, 2 where a file cannot be read.

    \b
    Example:
      colony test behaviors/wander.colony
    """
    from colony.diagnostics import Diagnostic, to_json
    from colony.verify.examples import failures_as_diagnostics, run_examples

    passed = failed = 0
    failures: list[Diagnostic] = []
    for file in files:
        with redirect_stdout(sys.stderr):  # for what modules in Python print
            results = run_examples(load_program(file))
        for result in results:
            passed, failed = passed + result.passed, failed + (not result.passed)
            if format_ == "text":
                mark = "passed" if result.passed else "FAILED"
                frames = f"{result.frames} frame{'' if result.frames == 1 else 's'}"
                click.echo(f"{file}: {mark}: {result.name} ({frames})")
        found = failures_as_diagnostics(results)
        failures += found
        if format_ == "text":
            report(found)
    if format_ == "json":
        click.echo(to_json(failures))
    else:
        click.echo(f"{passed} passed, {failed} failed" + ("" if passed or failed else ": there are no tests"))
    if failed:
        raise click.exceptions.Exit(EXIT_ERRORS)
