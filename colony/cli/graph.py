"""`colony graph`: the network as a picture, or as a graph for other tools."""

from __future__ import annotations

from pathlib import Path

import click

from colony.cli.outputs import BEHAVIOR, check_output, write_whole
from colony.cli.params_choice import params_option
from colony.cli.reporting import load_program
from colony.cli.robot_choice import description_option

FORMATS = {"svg": ".svg", "dot": ".dot", "graphml": ".graphml", "mermaid": ".mmd"}
"""The formats, and the suffixes that give them."""


@click.command("graph", short_help="draw the network as SVG, DOT, GraphML or Mermaid")
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
    type=click.Choice(list(FORMATS)),
    help="The format, if the suffix of the output file does not give it.",
)
@click.option(
    "--diff",
    "old",
    metavar="OLD",
    type=BEHAVIOR,
    help="Show what FILE changes in the network of OLD: as text, or in a picture in DOT or Mermaid.",
)
def command(file: str, output: Path | None, format_: str | None, old: str | None) -> None:
    """Draw the network: modules, actuators, and suppressor and inhibitor nodes with the dominant input on
    top.

    With --diff, print which modules and wires the change from OLD to FILE adds and removes, and which modules
    it moves in priority. With an output or a format, draw the network with the change marked.

    \b
    Example:
      colony graph wander
      colony graph wander -o wander.dot
      colony graph wander --format mermaid -o /dev/stdout
      colony graph --diff before.colony after.colony
    """
    suffix = "" if output is None else output.suffix
    kind = format_ or next((name for name, own in FORMATS.items() if own == suffix), None)
    context = click.get_current_context()
    if kind is None and output is not None:
        message = f"unknown format of `{output}`; expected a file ending in {_SUFFIXES}, or --format"
        raise click.UsageError(message, context)
    if old is not None and kind is None:
        _print_difference(old, file)
        return
    kind = kind or "svg"
    if old is not None and kind not in ("dot", "mermaid"):
        raise click.UsageError(
            "--diff draws in DOT and Mermaid alone, and prints text without a format", context
        )
    target = output or Path(Path(file).stem + FORMATS[kind])
    check_output(target, [file, *([old] if old else [])])
    write_whole(target, _drawn(file, old, kind))
    if target not in _STREAMS:
        click.echo(f"wrote {target}")


_STREAMS = (Path("/dev/stdout"), Path("/dev/stderr"))
_SUFFIXES = f"{', '.join(list(FORMATS.values())[:-1])} or {list(FORMATS.values())[-1]}"


def _print_difference(old: str, new: str) -> None:
    programs = load_program(old), load_program(new)
    from colony.view.graph.difference import difference_lines

    click.echo("\n".join(difference_lines(*programs) or ["the networks are the same"]))


def _drawn(file: str, old: str | None, kind: str) -> str:
    """Return the picture of a network in a format; with `old`, the change is marked."""
    program = load_program(file)
    before = None if old is None else load_program(old)
    title = Path(file).stem
    if kind == "graphml":
        from colony.view.graph.networkx import to_graphml

        return to_graphml(program)
    from colony.view.graph import graph
    from colony.view.graph.difference import marks_of

    if kind == "svg":
        return graph.to_svg(program, title)
    marks = None if before is None else marks_of(before, program)
    draw = graph.to_dot if kind == "dot" else graph.to_mermaid
    return draw(program, title, marks)
