"""`colony graph`: the network as a picture, or as a graph for other tools."""

from __future__ import annotations

from pathlib import Path

import click

from colony.cli.outputs import BEHAVIOR, check_output, write_whole
from colony.cli.params_choice import params_option
from colony.cli.reporting import load_program
from colony.cli.robot_choice import description_option

FORMATS = ("svg", "dot", "graphml")


@click.command("graph", short_help="draw the network as SVG, DOT or GraphML")
@click.argument("file", metavar="FILE", type=BEHAVIOR)
@description_option()
@params_option()
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PATH",
    help="The output file; its suffix gives the format. [default: FILE's name with .svg, in this folder]",
)
@click.option(
    "--format",
    "format_",
    type=click.Choice(FORMATS),
    help="The format, if the suffix of the output file does not give it.",
)
def command(file: str, output: Path | None, format_: str | None) -> None:
    """Draw the network: modules, actuators, and suppressor and inhibitor nodes with the dominant input on
    top.

    \b
    Example:
      colony graph wander
      colony graph wander -o wander.dot
    """
    kind = format_ or (output.suffix[1:] if output is not None else "svg")
    if kind not in FORMATS:
        message = (
            f"unknown format of `{output}`; expected a file ending in .svg, .dot or .graphml, or --format"
        )
        raise click.UsageError(message, click.get_current_context())
    target = output or Path(Path(file).stem + "." + kind)
    check_output(target, [file])
    program = load_program(file)
    title = Path(file).stem
    if kind == "svg":
        from colony.view.graph.graph import to_svg

        text = to_svg(program, title)
    elif kind == "dot":
        from colony.view.graph.graph import to_dot

        text = to_dot(program, title)
    else:
        from colony.view.graph.networkx import to_graphml

        text = to_graphml(program)
    write_whole(target, text)
    click.echo(f"wrote {target}")
