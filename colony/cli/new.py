"""`colony new`: a new project with a working behavior and tests."""

from __future__ import annotations

import re
import shlex
from importlib.resources import files
from pathlib import Path

import click

from colony.cli.outputs import cannot_write, check_output, write_whole
from colony.files import reason

TEMPLATES = files("colony.cli") / "templates" / "project"
BEHAVIOR = "NAME.colony"
ROBOT, ROBOT_ALONE = "import robot\n", 'import "rome"\n'
"""The robot of a behavior in a project, which names it, and of a behavior alone."""
TEMPLATE_SUFFIX = ".in"
"""Suffix of Python templates, so that no tool takes them for modules of this package."""


@click.command("new", short_help="start a project")
@click.argument("path", type=click.Path(path_type=Path), metavar="NAME[.colony]")
def command(path: Path) -> None:
    """Start a project: create a folder with a behavior, its property tests, a pyproject.toml and a README.

    The behavior has three modules, a network, a contract and a test, and says `import robot`; the project
    names the robot RoME. With NAME.colony only the behavior is created, for RoME. Existing files are never
    overwritten.

    \b
    Example:
      colony new patrol
      cd patrol
      colony test patrol.colony
    """
    if not path.name:
        raise click.UsageError("expected a name, such as `patrol`", click.get_current_context())
    if path.suffix == ".colony":
        check_output(path)
        write_whole(path, _filled(BEHAVIOR, path.stem).replace(ROBOT, ROBOT_ALONE))
        click.echo(f"wrote {path}; try: colony test {shlex.quote(str(path))}")
        return
    name = path.name
    if not re.fullmatch(r"[A-Za-z0-9]([A-Za-z0-9_-]{,98}[A-Za-z0-9])?", name):
        message = f"expected a name of letters, digits, `-` and `_`, such as `patrol`; found `{name[:100]}`"
        raise click.UsageError(message, click.get_current_context())
    try:
        path.mkdir()
    except OSError as problem:
        cannot_write(path, reason(problem))
    for template in sorted(entry.name for entry in TEMPLATES.iterdir() if entry.is_file()):
        target = template.replace("NAME", name).removesuffix(TEMPLATE_SUFFIX)
        write_whole(path / target, _filled(template, name))
    where = shlex.quote(str(path))
    click.echo(f"wrote {path}; try: cd {where} && colony test {shlex.quote(f'{name}.colony')}")


def _filled(template: str, name: str) -> str:
    return (TEMPLATES / template).read_text(encoding="utf-8").replace("NAME", name)
