"""`colony upgrade`: behavior files of version 1 of the language, rewritten as version 2."""

from __future__ import annotations

import codecs
import os
import re
from difflib import unified_diff
from pathlib import Path
from typing import TYPE_CHECKING

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.outputs import cannot_write, write_whole
from colony.cli.reporting import is_unreadable, one_line, report, say
from colony.cli.robot_choice import chosen_robot, description_option
from colony.collector import gc_paused
from colony.files import open_regular
from colony.text.wording import printable

if TYPE_CHECKING:
    from colony.dsl.upgrade_files import FileUpgrade

_LINES = re.compile(r"[^\n]*\n|[^\n]+")


@click.command("upgrade", short_help="rewrite behavior files for this version of the language")
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=click.Path())
@description_option()
@click.option(
    "--check", "check_only", is_flag=True, help="Write nothing; exit with 1 if a file would change."
)
@click.option("--diff", "show_diff", is_flag=True, help="Write nothing; print what would change.")
def command(files: tuple[str, ...], check_only: bool, show_diff: bool) -> None:
    """Rewrite behavior files of version 1 of the language as version 2, in place.

    A file that does not name its version is taken for version 1. Where the new text means the same, it is
    rewritten: `held` becomes `recently`, and `language 2` is added below the comment that begins the file, if
    an empty line ends that comment, and otherwise first. Comments and layout are kept. Where version 2
    decides differently, a warning asks for your decision; its place is that in the new text.

    A file that has the line already is not changed, and neither is one with errors. Imported files are
    rewritten only if they are named. Name a file that needs names of another one together with that one.
    Decisions are printed when a file is rewritten, and never again: --diff shows them before.

    Exit code: 0 without errors (warnings are allowed), 1 with errors or, with --check, if a file would
    change, 2 if a file cannot be read or written.

    \b
    Example:
      colony upgrade --diff patrol.colony
      colony upgrade *.colony
    """
    with gc_paused():
        from colony.dsl.upgrade_files import upgrade_files

        upgrades = upgrade_files(files, robot=chosen_robot())
    codes = {_process(upgrade, check_only=check_only, show_diff=show_diff) for upgrade in upgrades}
    if max(codes):
        raise click.exceptions.Exit(max(codes))


def _process(upgrade: FileUpgrade, *, check_only: bool, show_diff: bool) -> int:
    """Report and write the upgrade of a file; return its exit code."""
    name = printable(upgrade.name)
    if upgrade.new is None:
        if is_unreadable(upgrade.diagnostics):
            say(one_line(upgrade.diagnostics[0]))
            return EXIT_MISUSE
        report(upgrade.diagnostics)
        say(f"{name}: not changed, because it has errors")
        return EXIT_ERRORS
    if upgrade.new == upgrade.old:
        if not show_diff:
            click.echo(f"{name}: already version 2")
        return 0
    report(upgrade.diagnostics)
    for left in upgrade.left_behind:
        say(f"{name}: imports {printable(left)}, which is still version 1; upgrade it too")
    if show_diff:
        click.echo(_diff(upgrade, upgrade.new), nl=False)
    if check_only or show_diff:
        if not show_diff:
            click.echo(f"{name}: would be upgraded to version 2{_places(upgrade)}")
        return EXIT_ERRORS if check_only else 0
    _write(Path(upgrade.name), upgrade.new)
    click.echo(f"{name}: upgraded to version 2{_places(upgrade)}")
    return 0


def _places(upgrade: FileUpgrade) -> str:
    from colony.text.wording import counted

    return f"; {counted(len(upgrade.diagnostics), 'place')} to decide" if upgrade.diagnostics else ""


def _write(path: Path, text: str) -> None:
    """Replace a file atomically, with its byte order mark if it has one; exit with 2 if that fails."""
    with open_regular(path) as file:
        mark = file.read(len(codecs.BOM_UTF8))
        is_read_only = not os.fstat(file.fileno()).st_mode & 0o222
    if is_read_only or not os.access(path, os.W_OK):
        cannot_write(path, "Permission denied")
    write_whole(path, (mark if mark == codecs.BOM_UTF8 else b"") + text.encode())


def _diff(upgrade: FileUpgrade, new: str) -> str:
    lines = unified_diff(
        _LINES.findall(upgrade.old),
        _LINES.findall(new),
        printable(upgrade.name),
        f"{printable(upgrade.name)} (version 2)",
    )
    return "".join(
        line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n" for line in lines
    )
