"""`colony robot check`: a robot's interface and its body, held to each other."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.reporting import Format, format_option, formatted, is_unreadable, report, say
from colony.collector import gc_paused

if TYPE_CHECKING:
    from colony.body.reader import BodyFile
    from colony.dsl.load import Checked
    from colony.text.diagnostics import Diagnostic


# --- descriptions --------------------------------------------------------------------------------------
#
# Robots on the command line: their interfaces and bodies.


@dataclass(frozen=True, slots=True, kw_only=True)
class Described:
    """A robot whose interface and body were read.

    Attributes:
        text: the name or the path, as given.
        checked: the interface.
        body: the body; without content if the interface cannot be read.
        diagnostics: all findings: of the interface, of the body, and between both.
    """

    text: str
    checked: Checked
    body: BodyFile
    diagnostics: tuple[Diagnostic, ...]

    @property
    def is_unreadable(self) -> bool:
        """True if one of the two files cannot be read at all."""
        return any(d.code in ("E001", "E003", "B001") for d in self.diagnostics)


def describe(text: str) -> Described:
    """Return the robot with this name, or in the file of this path; exit with 2 if there is none."""
    from colony.body.disagreements import findings
    from colony.body.driver_signatures import driver_misfits
    from colony.body.reader import BodyFile, read_body
    from colony.dsl.descriptions import body_beside
    from colony.dsl.load import check_file
    from colony.text.diagnostics import in_order
    from colony.text.source import NOWHERE

    path = _found(text)
    checked = check_file(path)
    program = checked.program
    if is_unreadable(checked.diagnostics):
        body = BodyFile(
            source=NOWHERE.source, body=None, diagnostics=()
        )  # there is nothing to compare it with
    else:
        body = read_body(body_beside(path, path.stem if program is None else program.robot.name))
    of_body = body.diagnostics if program is None else findings(program.robot, body)
    found = in_order(
        (
            *checked.diagnostics,
            *of_body,
            *driver_misfits(body, () if program is None else program.robot.actuators),
        )
    )
    return Described(text=text, checked=checked, body=body, diagnostics=found)


def _found(text: str) -> Path:
    """Return the path of an interface as messages show it."""
    from colony.dsl.descriptions import find_description, find_project, shown, suggestion

    if Path(text).suffix == ".toml":
        interface = Path(text).with_suffix(".colony")
        advice = f"give the interface beside it, {interface}, or the name of the robot, {interface.stem}"
        say(f"error: `{text}` is no interface of a robot ({advice})")
        raise click.exceptions.Exit(EXIT_MISUSE)
    project = find_project(Path())
    folder = None if project is None else project.folder
    path = find_description(text, Path(), folder)
    if path is None:
        say(f"error: there is no description `{text}` ({suggestion(text, folder or Path())})")
        raise click.exceptions.Exit(EXIT_MISUSE)
    return Path(shown(path))


# --- check ---------------------------------------------------------------------------------------------


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
