"""`colony new`: a new project with a working behavior and tests."""

from __future__ import annotations

import re
import shlex
from importlib.resources import files
from pathlib import Path

import click

from colony.cli.outputs import cannot_write, check_output, write_whole
from colony.cli.reporting import exit_with, report
from colony.files import read_file, reason
from colony.text.diagnostics import DiagnosticError
from colony.text.source import Source

TEMPLATES = files("colony.cli") / "templates" / "project"
BEHAVIOR = "NAME.colony"
ROBOT, ROBOT_ALONE = "import robot\n", 'import "rome"\n'
"""The robot of a behavior in a project, which names it, and of a behavior alone."""
MAX_MUX_BYTES = 1 << 20
TEMPLATE_SUFFIX = ".in"
"""Suffix of Python templates, so that no tool takes them for modules of this package."""


@click.command("new", short_help="start a project")
@click.argument("path", type=click.Path(path_type=Path), metavar="NAME[.colony]")
@click.option(
    "--from-twist-mux",
    "mux_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Convert the YAML of a twist_mux into a behavior for a robot on ROS 2.",
)
def command(path: Path, mux_file: Path | None) -> None:
    """Start a project: create a folder with a behavior, its property tests, a pyproject.toml and a README.

    The behavior has three modules, a network, a contract and a test, and says `import robot`; the project
    names the robot RoME. With NAME.colony only the behavior is created, for RoME. Existing files are never
    overwritten.

    \b
    Example:
      colony new patrol
      cd patrol
      colony test patrol.colony
    \b
    In the place of a twist_mux of ROS 2:
      colony new mux --from-twist-mux twist_mux.yaml
      cd mux
      colony verify mux.colony
    """
    if not path.name:
        raise click.UsageError("expected a name, such as `patrol`", click.get_current_context())
    if path.suffix == ".colony" and mux_file is None:
        check_output(path)
        write_whole(path, _filled(BEHAVIOR, path.stem).replace(ROBOT, ROBOT_ALONE))
        click.echo(f"wrote {path}; try: colony test {shlex.quote(str(path))}")
        return
    name = path.name
    if not re.fullmatch(r"[A-Za-z0-9]([A-Za-z0-9_-]{,98}[A-Za-z0-9])?", name):
        message = f"expected a name of letters, digits, `-` and `_`, such as `patrol`; found `{name[:100]}`"
        raise click.UsageError(message, click.get_current_context())
    texts = None if mux_file is None else _of_twist_mux(mux_file, name)
    try:
        path.mkdir()
    except OSError as problem:
        cannot_write(path, reason(problem))
    if texts is not None:
        (path / "robots" / name).mkdir(parents=True)
        for file, text in texts.items():
            write_whole(path / file, text)
        click.echo(f"wrote {path}; try: cd {shlex.quote(str(path))} && colony verify {name}.colony")
        return
    for template in sorted(entry.name for entry in TEMPLATES.iterdir() if entry.is_file()):
        target = template.replace("NAME", name).removesuffix(TEMPLATE_SUFFIX)
        write_whole(path / target, _filled(template, name))
    where = shlex.quote(str(path))
    click.echo(f"wrote {path}; try: cd {where} && colony test {shlex.quote(f'{name}.colony')}")


def _of_twist_mux(file: Path, name: str) -> dict[str, str]:
    """Return the files of a project in the place of a twist_mux; exit with what is wrong with its YAML."""
    from colony.cli import twist_mux
    from colony.extras import expect_extras

    if re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) is None:
        message = f"expected a name of letters, digits and `_`, which a robot can have; found `{name}`"
        raise click.UsageError(message, click.get_current_context())
    expect_extras("sim")  # has the parser of YAML
    try:
        text = read_file(file, MAX_MUX_BYTES).decode()
    except (OSError, UnicodeDecodeError) as problem:
        raise click.UsageError(
            f"cannot read {file}: {reason(problem)}", click.get_current_context()
        ) from None
    try:
        mux = twist_mux.read_twist_mux(Source(str(file), text))
    except DiagnosticError as problem:
        exit_with(problem.diagnostics)
    report(mux.notes)
    return {
        f"{name}.colony": twist_mux.behavior_text(mux, name),
        f"robots/{name}/{name}.colony": twist_mux.interface_text(mux, name),
        f"robots/{name}/{name}.toml": twist_mux.body_text(mux, name),
        "colony.toml": f'robot = "{name}"\n',
    }


def _filled(template: str, name: str) -> str:
    return (TEMPLATES / template).read_text(encoding="utf-8").replace("NAME", name)
