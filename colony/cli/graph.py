"""`colony graph`: the network as a picture."""

from __future__ import annotations

from pathlib import Path

import click

from colony.cli.reporting import load_program, write_whole


@click.command("graph", short_help="draw the network as SVG or DOT")
@click.argument("file", metavar="FILE")
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Where to; .svg or .dot says which. [default: FILE's name with .svg, here]",
)
@click.option(
    "--format", "format_", type=click.Choice(["svg", "dot"]), help="Where the name does not say it."
)
def command(file: str, output: Path | None, format_: str | None) -> None:
    """Draw modules, suppressor and inhibitor nodes, each with its dominant side above, and actuators.

    \b
    Example:
      colony graph behaviors/wander.colony
      colony graph behaviors/wander.colony -o wander.dot
    """
    if output is not None and format_ is None and output.suffix not in (".svg", ".dot"):
        message = f"`{output}` ends neither in .svg nor in .dot: give --format"
        raise click.UsageError(message, click.get_current_context())
    kind = format_ or (output.suffix[1:] if output is not None else "svg")
    target = output or Path(Path(file).stem + "." + kind)
    program = load_program(file)
    from colony.compile.elaborate import elaborate
    from colony.view.graph import to_dot, to_svg

    draw = to_svg if kind == "svg" else to_dot
    write_whole(target, draw(elaborate(program), Path(file).stem))
    click.echo(f"wrote {target}")
