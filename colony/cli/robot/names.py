"""The names of robots that a command writes, and the places of their files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import click

from colony.cli.outputs import cannot_write, write_whole
from colony.files import reason
from colony.shipped import Shipped

FOLDER = Path("robots")
"""The folder of the robots of a project."""


def robot_name(name: str) -> None:
    """Refuse a name that a robot of a project cannot have; exit with 2."""
    from colony.dsl.load import check_text

    context = click.get_current_context()
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]{,63}", name):
        message = f"expected a name of letters, digits and `_`, such as `scout`; found `{name[:100]}`"
        raise click.UsageError(message, context)
    if name in Shipped.ROBOT.names():
        message = f"`{name}` comes with colony, and would no longer be found; choose another name"
        raise click.UsageError(message, context)
    if check_text(f"language 1\nrobot {name} {{ sensor a : number from B.c }}\n").program is None:
        raise click.UsageError(
            f"`{name}` is a word of the language; expected a name, such as `scout`", context
        )


def expect_free(paths: Iterable[Path]) -> None:
    """Refuse paths that exist already; exit with 2."""
    for path in paths:
        if path.exists() or path.is_symlink():
            cannot_write(path, "it exists already")


def write_description(texts: Mapping[Path, str]) -> None:
    """Write the files of a robot, by path, into its new folder; exit with 2 if one cannot be written."""
    for path, text in texts.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            cannot_write(path.parent, reason(problem))
        write_whole(path, text)
