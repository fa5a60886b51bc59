"""`colony new`: a first behavior file that checks, passes its tests and drives."""

from __future__ import annotations

import shlex
from importlib.resources import files
from pathlib import Path

import click

from colony.cli.outputs import check_output, write_whole


@click.command("new", short_help="write a first behavior file")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path), metavar="NAME[.colony]")
def command(file: Path) -> None:
    """Write a small behavior to start from: a robot, four modules, a network, a contract and a test.

    \b
    Example:
      colony new patrol
      colony test patrol.colony
    """
    if not file.name:
        raise click.UsageError("expected a name, such as `patrol`", click.get_current_context())
    target = file if file.suffix == ".colony" else file.with_name(file.name + ".colony")
    check_output(target)
    text = (files("colony.cli") / "templates" / "behavior.colony").read_text(encoding="utf-8")
    write_whole(target, text.replace("NAME", target.stem))
    click.echo(f"wrote {target}; try: colony test {shlex.quote(str(target))}")
