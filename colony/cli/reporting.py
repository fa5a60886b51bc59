"""Messages of commands: diagnostics on standard error, in color only on a terminal."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NoReturn

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.params_choice import chosen_params
from colony.cli.robot_choice import chosen_robot
from colony.ir.program import Program
from colony.text.diagnostics import Diagnostic, headline, render
from colony.text.wording import printable

if TYPE_CHECKING:
    from colony.dsl.load import Checked

Format = Literal["text", "json", "sarif"]

format_option = click.option(
    "--format",
    "format_",
    type=click.Choice(["text", "json", "sarif"]),
    default="text",
    show_default=True,
    help="Text for people; JSON; SARIF 2.1.0 for editors and code hosts.",
)
"""The option for a command's output format: a `Format`, as `format_`."""

PROGRESS_DELAY_S = 1.5
"""Seconds without a message after which a command reports its progress."""

_CONTROL = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f]")
"""Control characters of a terminal, except tabs and line breaks."""

_COLORS = {"error": "red", "warning": "yellow", "note": "cyan"}


def say(text: str) -> None:
    """Print a line on standard error, with control characters escaped.

    If standard error cannot be written, the command continues.
    """
    _echo(_escaped(text))


def _escaped(text: str) -> str:
    return _CONTROL.sub(lambda match: printable(match[0]), text)


def _echo(text: str) -> None:
    try:
        click.echo(text, err=True)
    except OSError:
        return


def report(diagnostics: Iterable[Diagnostic]) -> None:
    """Print each diagnostic with its source line, caret and hint, with control characters escaped."""
    colored = sys.stderr.isatty() and not os.environ.get("NO_COLOR")
    for diagnostic in diagnostics:
        text = _escaped(render(diagnostic))
        if colored:
            kind = f"{diagnostic.severity}[{diagnostic.code}]"
            text = text.replace(kind, click.style(kind, fg=_COLORS[diagnostic.severity], bold=True), 1)
        _echo(text)


def formatted(diagnostics: Sequence[Diagnostic], format_: Format) -> str:
    """Return diagnostics as SARIF, or as JSON for any other format."""
    if format_ == "sarif":
        from colony.cli.sarif import sarif

        return sarif(diagnostics, directory=Path.cwd())
    from colony.text.diagnostics import to_json

    return to_json(diagnostics)


def one_line(diagnostic: Diagnostic) -> str:
    """Return a diagnostic and its hint on one line, even if a file's name has line breaks."""
    hint = f" ({diagnostic.hint})" if diagnostic.hint else ""
    return "".join(c if c.isprintable() else " " for c in headline(diagnostic) + hint)


def refuse(diagnostics: Sequence[Diagnostic]) -> NoReturn:
    """Print the first diagnostic of an invalid input on one line, and exit with 2."""
    say(one_line(diagnostics[0]))
    raise click.exceptions.Exit(EXIT_MISUSE)


def is_unreadable(diagnostics: Sequence[Diagnostic]) -> bool:
    """Return True if the file itself, or that of params, could not be read, which is misuse."""
    return len(diagnostics) == 1 and diagnostics[0].code in ("E001", "E003", "E701")


def check_to_run(path: str) -> Checked:
    """Check a file; also search its directory and the current one for Python modules."""
    from colony.dsl.load import check_file

    checked = check_file(path, robot=chosen_robot(), params=chosen_params())
    if checked.program is not None:
        sys.path += [str(Path(path).resolve().parent), os.curdir]
    return checked


def load_program(path: str, code: int = EXIT_ERRORS) -> Program:
    """Return the program of a file, without its warnings, which only `colony check` reports.

    Exits with 2 if the file cannot be read, with `code` if it has errors.
    """
    checked = check_to_run(path)
    if checked.program is None:
        exit_with(checked.diagnostics, code)
    return checked.program


def exit_with(diagnostics: Sequence[Diagnostic], code: int = EXIT_ERRORS) -> NoReturn:
    """Report why there is no program; exit with 2 if a file cannot be read, and with `code` otherwise."""
    if is_unreadable(diagnostics):
        refuse(diagnostics)
    report(diagnostics)
    raise click.exceptions.Exit(code)
