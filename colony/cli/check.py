"""`colony check`: all errors and warnings in behavior files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, cast

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.outputs import BEHAVIOR
from colony.cli.params_choice import chosen_params, params_option
from colony.cli.reporting import Format, format_option, formatted, is_unreadable, one_line, report, say
from colony.cli.robot_choice import repeated_description_option
from colony.collector import gc_paused

if TYPE_CHECKING:
    from colony.dsl.descriptions import RobotChoice
    from colony.dsl.load import Checked
    from colony.text.diagnostics import Diagnostic


_ANY: dict[str, RobotChoice | None] = {"": None}
"""The robots of a check without `--robot`: whichever the file's project names."""


@click.command("check", short_help="find errors in behavior files")
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=BEHAVIOR)
@repeated_description_option()
@params_option()
@format_option
def command(files: tuple[str, ...], robots: dict[str, RobotChoice], format_: str) -> None:
    """Check behavior files and everything that they import: syntax, names, types, units, wiring.

    The sensors and actuators of the program's robot are held to its body, if the robot has one: servers,
    fields, commands, types, sizes, ranges, and rates slower than `within` (docs/robots.md).

    All errors and warnings are reported, each with its location and a hint. A note reports each file that
    does not name its version with `language 1`, and each robot without a body. With several --robot each file
    is checked against each of these descriptions; a finding that is not about all of them names its robot.

    Exit code: 0 without errors (warnings and notes are allowed), 1 with errors, 2 if a file cannot be read.

    \b
    Example:
      colony check wander
      colony check patrol.colony --robot rome --robot amr
      colony check --format json behaviors/*.colony
      colony check --format sarif behaviors/*.colony > check.sarif
    """
    with gc_paused():
        from colony.cli.body_check import BodyCheck
        from colony.dsl.load import check_file
        from colony.text.diagnostics import has_errors, in_order

        diagnostics: list[Diagnostic] = []
        bodies = BodyCheck()
        noted: set[str] = set()
        unreadable = False
        for file in files:
            by_robot = {
                name: check_file(file, robot=robot, params=chosen_params())
                for name, robot in (robots or _ANY).items()
            }
            checked = next(iter(by_robot.values()))
            findings = {
                name: (*one.diagnostics, *(() if one.program is None else bodies.findings(one.program)))
                for name, one in by_robot.items()
            }
            notes = [note for one in by_robot.values() for note in _notes(one, noted)]
            found = in_order((*_of_all(findings), *notes))
            diagnostics += found
            is_missing = is_unreadable(checked.diagnostics)
            unreadable = unreadable or is_missing
            if format_ == "text":
                if is_missing:
                    say(one_line(checked.diagnostics[0]))
                else:
                    report(found)
                if not has_errors(found):
                    click.echo(f"{file}: ok")
    if format_ != "text":
        click.echo(formatted(diagnostics, cast(Format, format_)))
    if unreadable:
        raise click.exceptions.Exit(EXIT_MISUSE)
    if has_errors(diagnostics):
        raise click.exceptions.Exit(EXIT_ERRORS)


def _of_all(by_robot: Mapping[str, Sequence[Diagnostic]]) -> Iterator[Diagnostic]:
    """Yield the findings of checks against several robots; one that is not of all says of which it is."""
    from colony.text.wording import listed

    seen: dict[tuple[object, ...], list[str]] = {}
    first: dict[tuple[object, ...], Diagnostic] = {}
    for name, diagnostics in by_robot.items():
        for d in diagnostics:
            key: tuple[object, ...] = (d.code, d.span.source.name, d.span.start, d.span.end, d.message)
            first.setdefault(key, d)
            names = seen.setdefault(key, [])
            names += [] if name in names else [name]
    for key, d in first.items():
        of_some = (
            f"{listed([f'`{n}`' for n in seen[key]], 'and')}: " if len(seen[key]) < len(by_robot) else ""
        )
        yield replace(d, message=f"{of_some}{d.message}")


def _notes(checked: Checked, noted: set[str]) -> Iterator[Diagnostic]:
    """Yield a note for each file without a version, unless it is in `noted`, or has syntax errors."""
    from colony.dsl.parse import SYNTAX_CODES, version_note

    misread = {id(d.span.source) for d in checked.diagnostics if d.code in SYNTAX_CODES}
    for file in checked.tree.files:
        if file.tree.language is None and file.key not in noted and id(file.source) not in misread:
            yield version_note(file.source)
        noted.add(file.key)
