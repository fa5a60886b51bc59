"""`colony fmt`: the one style of behavior files."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from difflib import unified_diff
from io import StringIO
from pathlib import Path

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.outputs import write_whole
from colony.cli.reporting import one_line, report, say

_STDIN = "-"
_STDIN_NAME = "<stdin>"


@click.command("fmt", short_help="format behavior files in the one style")
@click.argument("paths", nargs=-1, metavar="[FILE|FOLDER|-]...")
@click.option("--check", is_flag=True, help="Write nothing, and name the files that are not in the style.")
@click.option("--diff", is_flag=True, help="Write nothing, and show what would change.")
def command(paths: tuple[str, ...], check: bool, diff: bool) -> None:
    """Format behavior files, and those in folders, by default in this one; `-` formats standard input.

    Indentation, blanks and alignment are set; comments, line breaks and single blank lines are kept, and
    lines of more than 110 columns are broken. A program means the same afterwards. A file with syntax errors
    stays as it is, and its errors are shown.

    Exit code: 0 if all files are in the style now, 1 if --check or --diff found one that is not, 2 if a file
    cannot be read or has syntax errors.

    \b
    Example:
      colony fmt patrol.colony
      colony fmt --check behaviors robots
      colony fmt - < patrol.colony
    """
    from colony.dsl.files import UnreadableFileError
    from colony.editing.formatting import formatted
    from colony.text.diagnostics import DiagnosticError
    from colony.text.source import Source, Span

    is_misuse = differs = False
    for path in _files(paths or (".",)):
        name = _STDIN_NAME if path == _STDIN else path
        try:
            text = _text(path)
            result = formatted(text, name)
        except UnreadableFileError as problem:
            say(one_line(problem.diagnostic(Span(Source(name, ""), 0, 0))))
            is_misuse = True
            continue
        except DiagnosticError as problem:
            report(problem.diagnostics)
            is_misuse = True
            continue
        differs = differs or result != text
        if diff:
            click.echo("".join(_difference(text, result, name)), nl=False)
        elif path == _STDIN and not check:
            click.echo(result, nl=False)
        elif result != text:
            if not check:
                write_whole(Path(path), result)
            click.echo(f"{name}: {'not ' if check else ''}formatted")
    if is_misuse:
        raise click.exceptions.Exit(EXIT_MISUSE)
    if differs and (check or diff):
        raise click.exceptions.Exit(EXIT_ERRORS)


def _difference(text: str, result: str, name: str) -> Iterator[str]:
    """Yield the lines of a unified difference, as `patch` reads it."""
    before, after = (list(StringIO(x, newline="\n")) for x in (text, result))
    for line in unified_diff(before, after, name, f"{name} (formatted)"):
        yield line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n"


def _files(paths: tuple[str, ...]) -> Iterator[str]:
    """Yield the files, and in the place of a folder the behavior files in it that are not hidden."""
    for path in paths:
        if path == _STDIN or not Path(path).is_dir():
            yield path
            continue
        for file in sorted(Path(path).rglob("*.colony")):
            if not any(part.startswith(".") for part in file.relative_to(path).parts) and file.is_file():
                yield str(file)


def _text(path: str) -> str:
    """Return the text of a file, or of standard input."""
    from colony.dsl.files import decode, read_source

    if path == _STDIN:
        return decode(sys.stdin.buffer.read(), _STDIN_NAME).text
    return read_source(Path(path), path).text
