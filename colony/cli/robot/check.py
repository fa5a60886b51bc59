"""`colony robot check`: a robot's interface and its body, held to each other."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.reporting import Format, format_option, formatted, report
from colony.cli.robot.descriptions import describe
from colony.collector import gc_paused

if TYPE_CHECKING:
    from colony.text.diagnostics import Diagnostic


@click.command("check", short_help="compare a robot's interface with its body")
@click.argument("names", nargs=-1, required=True, metavar="NAME...")
@format_option
def check_command(names: tuple[str, ...], format_: str) -> None:
    """Check the interface and the body of robots, and hold both to each other.

    NAME is the name of a robot that comes with colony or is in the folder robots, or the path of an
    interface; the body is beside it, in ROBOT.toml, which is named after the robot. All errors are
    reported, each with its location and a hint: servers, fields and commands that one of the two lacks, other
    elements or bearings than the device has, ranges beyond the limits of the base, rates slower than
    `within`.

    Exit code: 0 without errors (warnings are allowed), 1 with errors, 2 if a file cannot be read.

    \b
    Example:
      colony robot check rome
      colony robot check robots/amr/amr.colony
      colony robot check rome amr --format json
    """
    with gc_paused():
        from colony.text.diagnostics import has_errors

        diagnostics: list[Diagnostic] = []
        unreadable = False
        for name in names:
            robot = describe(name)
            diagnostics += robot.diagnostics
            unreadable = unreadable or robot.is_unreadable
            if format_ == "text":
                report(robot.diagnostics)
                if not has_errors(robot.diagnostics):
                    click.echo(f"{name}: ok")
    if format_ != "text":
        click.echo(formatted(diagnostics, cast(Format, format_)))
    if unreadable:
        raise click.exceptions.Exit(EXIT_MISUSE)
    if has_errors(diagnostics):
        raise click.exceptions.Exit(EXIT_ERRORS)
