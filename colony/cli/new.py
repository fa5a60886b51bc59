"""`colony new`: a first behavior file that checks, passes its tests and drives."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import click

from colony.cli.reporting import EXIT_MISUSE, write_whole


@click.command("new", short_help="write a first behavior file")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path), metavar="NAME[.colony]")
def command(file: Path) -> None:
    """Write a small behavior to start from: a robot, four modules, a network, a contract and a test.

    \b
    Example:
      colony new patrol
      colony test patrol.colony
    """
    target = file if file.suffix == ".colony" else file.with_name(file.name + ".colony")
    if target.exists():
        click.echo(f"{target}: error: it exists already and is left as it is", err=True)
        raise click.exceptions.Exit(EXIT_MISUSE)
    text = (files("colony.cli") / "templates" / "behavior.colony").read_text(encoding="utf-8")
    write_whole(target, text.replace("NAME", target.stem))
    click.echo(f"wrote {target}; try: colony test {target}")
