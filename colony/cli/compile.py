"""`colony compile`: the prioritized clients that a behavior compiles to."""

from __future__ import annotations

from pathlib import Path

import click

from colony.cli.outputs import check_output, write_whole
from colony.cli.reporting import load_program


@click.command("compile", short_help="show the prioritized clients that a behavior compiles to")
@click.argument("file", metavar="FILE")
@click.option("--explain", is_flag=True, help="Show each step: network, elimination, tree, order of visit.")
@click.option(
    "--format",
    "format_",
    type=click.Choice(["table", "json", "python"]),
    default="table",
    show_default=True,
    help="A table for people, JSON for programs, or a Python class that needs nothing of colony.",
)
@click.option("-o", "--output", type=click.Path(dir_okay=False, path_type=Path), help="Write there instead.")
def command(file: str, explain: bool, format_: str, output: Path | None) -> None:
    """Eliminate the inhibitors, number the modules by a forward traversal, and show the clients.

    \b
    Example:
      colony compile behaviors/wander.colony
      colony compile --explain behaviors/figure_4_14.colony
      colony compile --format python behaviors/wander.colony -o wander.py
    """
    if explain and format_ != "table":
        raise click.UsageError("--explain goes with --format table", click.get_current_context())
    if output is not None:
        check_output(output, [file])
    program = load_program(file)
    from colony.compile.pipeline import compile_program

    compiled = compile_program(program)
    if format_ == "python":
        from colony.compile.backends.python import generate

        text = generate(program, compiled.clients)
    elif format_ == "json":
        from colony.compile.json_format import to_json

        text = to_json(compiled)
    else:
        from colony.compile.client_table import client_table
        from colony.compile.explain import explain as explanation

        text = explanation(compiled) if explain else client_table(compiled)
    if not text.endswith("\n"):
        text += "\n"
    if output is None:
        click.echo(text, nl=False)
    else:
        write_whole(output, text)
